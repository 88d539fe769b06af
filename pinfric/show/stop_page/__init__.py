"""The page of `pinfric stop`."""
