"""Studies that the report carries: how the model's answers depend on what a user chooses."""
