"""The process that serves the network: admission, lease, publisher, history, mismatch watch."""
