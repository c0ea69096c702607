"""The consequences of changed rules, for recorded sessions, mission sets and single plans."""
