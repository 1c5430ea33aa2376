"""What a camera does to the light on its way to an 8-bit image, one effect a file."""
