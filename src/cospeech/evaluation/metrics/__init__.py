"""The metrics, each after its publication, and the networks that some of them are measured with."""
