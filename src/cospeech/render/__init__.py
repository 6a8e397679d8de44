"""Pictures of motion: stills, mp4 videos and the report page. Import the modules by name; they load when used."""
