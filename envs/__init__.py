"""Gymnasium environments. `gymnasium.make("envs:MarsNav-v0")`, or `import envs` first. Loads no torch by itself."""

import gymnasium

gymnasium.register(id="MarsNav-v0", entry_point="envs.mars_nav:MarsNavEnv")
