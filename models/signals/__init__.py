"""What is done with joined recordings whatever moves the stage: operators, filters, spectra."""
