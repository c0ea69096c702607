"""The radio links between the station and its devices."""
