"""What remote programs talk to a daemon with: client, player, telemetry."""
