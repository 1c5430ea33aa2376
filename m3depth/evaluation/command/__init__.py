"""What m3depth.evaluate is asked: its flags, the methods that they name, and what its figures depend on."""
