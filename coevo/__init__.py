"""Co-evolve teams of robots whose trees choose among learned skills."""
