"""What an order points at instead of naming it: found in the picture and in what was ordered."""
