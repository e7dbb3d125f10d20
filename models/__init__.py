"""Pure computation: the model of a piezo stage, its identification, inverse and diagnosis."""
