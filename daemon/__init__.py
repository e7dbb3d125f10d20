"""The service on the stage controller and its command line."""
