"""Self-test of a machine: does it meet the deadlines of the loop?"""
