"""The mismatch watch: does the stage still behave as its model?"""
