"""The compared models, one file for each kind; table.py lists them."""
