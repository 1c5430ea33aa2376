"""Sand on the ground: the drifts against rocks and slabs, and the surface that they lie on."""
