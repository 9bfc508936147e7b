"""The words that people at the bench read: messages that stay data until they are shown, and their catalogues."""
