"""The ground's relief as a function of world position: the surface that rays hit, down to the pebble."""
