"""Passes beside Combined: what each takes from the loop, asked for by name; one that is not asked for is not called."""
