"""Amplifiers and sensors behind two small interfaces."""
