"""How surfaces and sky look: albedo, texture, reflectance and light."""
