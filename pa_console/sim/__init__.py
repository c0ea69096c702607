"""The simulated checkpoint: world files, routes, motion, devices, tracks, link, telemetry."""
