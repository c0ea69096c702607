"""The data model: strict pydantic models shared by every other package."""
