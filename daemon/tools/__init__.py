"""What the longer commands do: acquire, demo, latency test, configurations of the emulated
bench."""
