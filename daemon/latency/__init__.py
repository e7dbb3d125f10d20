"""The self-test of a machine: does it hold the deadlines of the loop?"""
