"""Builds the objects and reads the configuration: the only room that knows all the others."""
