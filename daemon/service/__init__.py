"""Keep the processes alive and the output safe: supervisor, heartbeat, safe state."""
