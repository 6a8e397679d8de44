"""Web pages of one file that open offline: the player, the report with its sections, and a take's quality."""
