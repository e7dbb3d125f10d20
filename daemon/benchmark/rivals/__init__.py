"""The models that are compared, one file for each; each is found in table.py."""
