"""A measuring run: moving an axis to its targets, reading there, and evaluating the readings."""
