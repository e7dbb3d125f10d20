"""Drives to record with: designed, checked for what they show, and chosen to distinguish two
physics."""
