"""The live view of `watch`. It needs rich, of the extra `watch`, and nobody else imports it."""
