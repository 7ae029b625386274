// An agent of Vercel AI SDK plays one episode; docs/clients.md says how it is started.
//
//     npm install ai@6.0.326 @ai-sdk/mcp@1.0.101 @ai-sdk/openai-compatible@2.0.87

import { createMCPClient } from "@ai-sdk/mcp";
import { createOpenAICompatible } from "@ai-sdk/openai-compatible";
import { generateText, stepCountIs } from "ai";

const { OPENAI_BASE_URL, OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const provider = createOpenAICompatible({ name: "smartplay", baseURL: OPENAI_BASE_URL, apiKey: "none" });
const server = await createMCPClient({ transport: { type: "http", url: SMARTPLAY_MCP_URL } });
const { text } = await generateText({
  model: provider(OPENAI_MODEL),
  tools: await server.tools(),
  prompt: "Play.",
  stopWhen: stepCountIs(1000),
});
console.log(text);
await server.close();
