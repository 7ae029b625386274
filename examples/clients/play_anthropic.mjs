// An agent of Anthropic's SDK plays one episode; docs/clients.md says how it is started.
//
//     npm install @anthropic-ai/sdk@1.12.0 @modelcontextprotocol/sdk@1.32.2

import Anthropic from "@anthropic-ai/sdk";
import { mcpTools } from "@anthropic-ai/sdk/helpers/beta/mcp";
import { Client } from "@modelcontextprotocol/sdk/client/index.js";
import { StreamableHTTPClientTransport } from "@modelcontextprotocol/sdk/client/streamableHttp.js";

const { ANTHROPIC_MODEL, SMARTPLAY_MCP_URL } = process.env;
const server = new Client({ name: "player", version: "1.0.0" });
await server.connect(new StreamableHTTPClientTransport(new URL(SMARTPLAY_MCP_URL)));
const { tools } = await server.listTools();
const runner = new Anthropic().beta.messages.toolRunner({
  model: ANTHROPIC_MODEL,
  max_tokens: 1000,
  messages: [{ role: "user", content: "Play." }],
  tools: mcpTools(tools, server),
});
console.log((await runner.runUntilDone()).content);
await server.close();
