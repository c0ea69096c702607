"""The data model: strict pydantic models that all other packages share."""
