"""Find what has changed in a stage whose model was right: the single cause and a correct model."""
