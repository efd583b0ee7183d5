"""Several learned skills become one (Uchibe 1999, appendix B.2)."""
