"""An evaluation of drives: its settings, its episodes, its results, films and bags, and how it goes on."""
