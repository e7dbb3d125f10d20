"""Access to a daemon for remote programs: client, player, telemetry."""
