"""Orders that hold from now on: whenever a drone is below 20 %, relieve it."""
