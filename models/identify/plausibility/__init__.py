"""Whether recordings can be of a stage of this class, and the model one of them."""
