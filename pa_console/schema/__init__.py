"""What things are: strict pydantic models shared by every other package."""
