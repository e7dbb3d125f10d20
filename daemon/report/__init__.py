"""Reports and pictures.

page builds the HTML page and plotting sets the style of every picture. identification and diagnosis
define the content of their reports; *_pictures, coverage and tracking draw.
"""
