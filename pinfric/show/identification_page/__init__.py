"""The page that `pinfric identify` writes."""
