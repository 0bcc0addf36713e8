"""Say something that may neither be lost nor raised, because an exception is on its way already."""


def warn(text: str) -> None:
    """Log a warning under the name `litegrip_client`."""
    import logging  # noqa: PLC0415 - takes milliseconds to import, and is hardly ever needed

    logging.getLogger("litegrip_client").warning("%s", text)
