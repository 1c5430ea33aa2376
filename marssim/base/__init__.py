"""What every package stands on: cameras, rover, datasets, files, commands. Loads no scene, renderer or physics."""
