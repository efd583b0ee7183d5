"""Several robots of one team or of two that learn by turns, each by several rewards (Uchibe 1999, 5.5.3 and 5.5.4)."""
