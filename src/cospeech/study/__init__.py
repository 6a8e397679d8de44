"""People judge: a study's page that opens from disk, and the tables of what its participants answered."""
