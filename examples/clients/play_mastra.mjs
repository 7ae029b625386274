// An agent of Mastra plays one episode; docs/clients.md says how it is started.
//
//     npm install @mastra/core@0.24.9 @mastra/mcp@0.14.5

import { Agent } from "@mastra/core/agent";
import { MCPClient } from "@mastra/mcp";

const { OPENAI_BASE_URL, OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const client = new MCPClient({ servers: { smartplay: { url: new URL(SMARTPLAY_MCP_URL) } } });
const agent = new Agent({
  name: "player",
  instructions: "Play.",
  model: { providerId: "smartplay", modelId: OPENAI_MODEL, url: OPENAI_BASE_URL, apiKey: "none" },
  tools: await client.getTools(),
});
console.log((await agent.generate("Play.", { maxSteps: 1000 })).text);
await client.disconnect();
