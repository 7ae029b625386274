# Cline plays one episode; docs/clients.md says how it is started.
#
#     npm install cline@3.0.65
#     smartplay-tools agent ... --only-game-tools

export HOME=$(mktemp -d)
mkdir -p "$HOME/.cline/data/settings"
cat > "$HOME/.cline/data/settings/cline_mcp_settings.json" <<END
{"mcpServers": {"smartplay": {
  "type": "streamableHttp", "url": "$SMARTPLAY_MCP_URL", "autoApprove": ["observe", "act", "read_manual"]
}}}
END
./node_modules/.bin/cline auth -p openai-compatible -k none -m "$OPENAI_MODEL" -b "$OPENAI_BASE_URL"
./node_modules/.bin/cline "Play the game until it is over."
