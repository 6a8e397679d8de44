"""The database: the training takes cut into clips, with what the search compares."""
