"""The mismatch monitor: does the stage still behave as its model predicts?"""
