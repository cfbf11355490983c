"""The commands for users, one file each."""
