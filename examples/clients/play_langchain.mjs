// An agent of LangChain plays one episode; docs/clients.md says how it is started.
//
//     npm install langchain@1.5.14 @langchain/core @langchain/openai@1.5.8 @langchain/mcp-adapters@1.1.4

import { MultiServerMCPClient } from "@langchain/mcp-adapters";
import { ChatOpenAI } from "@langchain/openai";
import { createAgent } from "langchain";

const { OPENAI_BASE_URL, OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const model = new ChatOpenAI({ model: OPENAI_MODEL, configuration: { baseURL: OPENAI_BASE_URL } });
const client = new MultiServerMCPClient({ smartplay: { transport: "http", url: SMARTPLAY_MCP_URL } });
const agent = createAgent({ model, tools: await client.getTools() });
const { messages } = await agent.invoke({ messages: "Play." }, { recursionLimit: 10_000 });
console.log(messages.at(-1).content);
await client.close();
