"""Mutants: small mistakes put into the code one by one, each of which some test should notice."""
