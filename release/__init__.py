"""Builds and checks the parts of a release: `make release`."""
