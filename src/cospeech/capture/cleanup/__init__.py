"""Clean-up: a track becomes motion on the clip's clock, with constant bones, and a judgement of its quality."""
