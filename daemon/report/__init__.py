"""Reports and pictures for people.

page builds the page, plotting sets the look of every picture; identification and diagnosis say what
stands in their reports, *_pictures, coverage and tracking draw.
"""
