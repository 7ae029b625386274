"""The window endpoint: the game's own context window behind OpenAI's interface, for agents in any language.

An agent points its `base_url` at it and plays under the exact budget: the real model behind the endpoint sees the
game's window and nothing else, whatever the agent keeps, trims or adds to its own messages. The agent runs the tool
calls, over MCP or in this process, and every reply, call and budget is in the record as in any other episode.
"""
