# Codex plays one episode; docs/clients.md says how it is started.
#
#     npm install @openai/codex@0.169.0
#     smartplay-tools agent ... --only-game-tools

export CODEX_HOME=$(mktemp -d)
cat > "$CODEX_HOME/config.toml" <<END
model = "$OPENAI_MODEL"
model_provider = "smartplay"
web_search = "disabled"
check_for_update_on_startup = false
[analytics]
enabled = false
[features]
plugins = false
[model_providers.smartplay]
name = "smartplay"
base_url = "$OPENAI_BASE_URL"
wire_api = "responses"
env_key = "OPENAI_API_KEY"
[mcp_servers.smartplay]
url = "$SMARTPLAY_MCP_URL"
END
./node_modules/.bin/codex exec --skip-git-repo-check --sandbox read-only "Play the game until it is over."
