"""How a command claims, locks and checks the folder of its results."""
