"""The process with the network: admission, lease, publisher, history, mismatch watch."""
