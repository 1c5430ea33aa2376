"""The ground of a scene: what covers it, the sand against its rocks, and the noise that draws both."""
