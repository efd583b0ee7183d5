"""The soccer world: field, robots, physics, cameras, events."""
