// An agent of mcp-use plays one episode; docs/clients.md says how it is started.
//
//     npm install mcp-use@1.34.6 langchain@1.5.14 @langchain/openai@1.5.8

import { ChatOpenAI } from "@langchain/openai";
import { MCPAgent, MCPClient } from "mcp-use";

const { OPENAI_BASE_URL, OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const llm = new ChatOpenAI({ model: OPENAI_MODEL, configuration: { baseURL: OPENAI_BASE_URL } });
const client = MCPClient.fromDict({ mcpServers: { smartplay: { url: SMARTPLAY_MCP_URL } } });
const agent = new MCPAgent({ llm, client, maxSteps: 1000 });
console.log(await agent.run("Play."));
await client.closeAllSessions();
