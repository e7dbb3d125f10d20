"""Drives to record with: designed, checked for what they show, and chosen to tell two physics
apart."""
