"""The bus: messages, topics, keys, who may do what. The only place that imports zenoh and
msgpack."""
