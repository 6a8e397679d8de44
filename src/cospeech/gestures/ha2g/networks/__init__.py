"""The networks of HA2G and of what stands beside it, by the names of the publication."""
