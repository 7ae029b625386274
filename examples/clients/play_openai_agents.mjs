// An agent of OpenAI's Agents SDK plays one episode; docs/clients.md says how it is started.
//
//     npm install @openai/agents@0.20.0

import { Agent, MCPServerStreamableHttp, run, setTracingDisabled } from "@openai/agents";

setTracingDisabled(true);
const { OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const server = new MCPServerStreamableHttp({ url: SMARTPLAY_MCP_URL });
await server.connect();
const agent = new Agent({ name: "player", model: OPENAI_MODEL, mcpServers: [server] });
console.log((await run(agent, "Play.", { maxTurns: 1000 })).finalOutput);
await server.close();
