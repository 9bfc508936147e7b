"""Files of users, read and written: YAML with places, models with units; knows no robot."""
