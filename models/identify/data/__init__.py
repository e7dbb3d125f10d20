"""What of the recordings is fitted: rows that count, glitches left out, stretches held out."""
