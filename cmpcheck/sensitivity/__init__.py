"""What the suite would have caught: seeded errors, false alarms, power (start with `command.py`)."""
