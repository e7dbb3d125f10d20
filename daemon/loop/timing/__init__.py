"""Deadlines of the loop, causes of missed ones, and the real-time priority of the process."""
