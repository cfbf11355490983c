"""From one file for a site to a folder for each of its machines."""
