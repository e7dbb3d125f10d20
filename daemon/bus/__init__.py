"""The bus: messages, topics, keys, access control. Only this package imports zenoh and msgpack."""
