"""What is wrong with a configuration beyond its words: six files, by what they look at."""
