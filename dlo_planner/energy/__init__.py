"""What a shape costs: elastic energy and loads."""
