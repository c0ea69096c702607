"""The simulated checkpoint: world files, routes, motion, devices, tracks, links and telemetry."""
