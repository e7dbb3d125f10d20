"""Drivers of amplifiers and sensors, which implement two small interfaces."""
