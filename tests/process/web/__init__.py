"""The page in the browser: who may ask, what it passes on, and what is seen and done on it."""
