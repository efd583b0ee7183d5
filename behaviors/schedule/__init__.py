"""Two robots learn to pass and to shoot in periods (Uchibe 1999, 3.4 and 3.5)."""
