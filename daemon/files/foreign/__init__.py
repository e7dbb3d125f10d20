"""Recordings that other programs wrote: what their columns mean is understood here, and said."""
