"""The checkpoint in simulation: world files, routes, motion, devices, tracks, link, telemetry."""
