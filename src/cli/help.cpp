#include "help.hpp"

#include <algorithm>
#include <map>
#include <string_view>
#include <vector>

namespace servosense::cli {
namespace {

constexpr const char* kPurpose =
    "cutting force and alarms from the signals that every servo drive has";
constexpr const char* kNoSafety = "A monitoring aid, not a safety function.";

struct ExitStatus {
  const char* status;
  const char* meaning;
};
constexpr ExitStatus kExitStatus[] = {
    {"0", "done"},
    {"1", "--fail-on-alarm and an alarm, or nothing was watched; --fail-on-finding and a finding"},
    {"2", "wrong usage"},
    {"3", "bad input data"},
    {"4", "a device or file could not be used"}};

std::vector<const Option*> all_options(const Command& command) {
  std::vector<const Option*> all;
  for (const Option& option : command.options) all.push_back(&option);
  for (const Option& option : common_options()) all.push_back(&option);
  return all;
}

std::string spelling(const Option& option) {
  return option.name + (option.value.empty() ? "" : " " + option.value);
}

std::string usage(const Command& command) {
  std::string text = "servosense " + command.name;
  for (const Option& option : command.options)
    if (option.required) text += " " + spelling(option);
  text += " [options]";
  if (!command.operands.empty()) text += " " + command.operands;
  return text;
}

/// Rows of two columns that line up.
std::string in_columns(const std::vector<std::pair<std::string, std::string>>& rows) {
  std::size_t width = 0;
  for (const auto& [left, right] : rows) width = std::max(width, left.size());
  std::string text;
  for (const auto& [left, right] : rows)
    text += "  " + left + std::string(width + 2 - left.size(), ' ') + right + "\n";
  return text;
}

/// For man(7): no line is taken for a macro, no dash for a hyphen.
std::string roff(const std::string& text) {
  std::string out;
  bool line_begins = true;
  for (const char c : text) {
    if (line_begins && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
    line_begins = c == '\n';
  }
  return out;
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

}  // namespace

std::string overview_text(std::span<const Command> commands, const std::string& group) {
  std::vector<std::pair<std::string, std::string>> rows;
  for (const Command& command : commands)
    if (group.empty() || command.name.starts_with(group + " "))
      rows.emplace_back(command.name, command.summary);
  if (!group.empty())
    return "usage: servosense " + group + " <what> [options]\n\n" + in_columns(rows) +
           "\n'servosense help " + group + " <what>' explains one of them.\n";
  return std::string("servosense: ") + kPurpose + "\n\nusage: servosense <command> [options]\n\n" +
         in_columns(rows) + "\n'servosense help <command>' explains one command.\n" + kNoSafety +
         "\n";
}

std::string help_text(const Command& command) {
  std::string text = "servosense " + command.name + " - " + command.summary +
                     "\n\nusage: " + usage(command) + "\n\n";
  std::vector<std::pair<std::string, std::string>> rows;
  for (const Option* option : all_options(command))
    rows.emplace_back(spelling(*option), option->meaning + (option->required ? " (required)" : ""));
  text += in_columns(rows);
  if (!command.notes.empty()) text += "\n" + command.notes + "\n";
  text += "\nexit status:\n";
  rows.clear();
  for (const ExitStatus& exit : kExitStatus) rows.emplace_back(exit.status, exit.meaning);
  return text + in_columns(rows);
}

std::string man_page(std::span<const Command> commands, const std::string& version) {
  std::string text = ".TH SERVOSENSE 1 \"\" \"servosense " + roff(version) +
                     "\"\n.SH NAME\nservosense \\- " + roff(kPurpose) +
                     "\n.SH SYNOPSIS\n.B servosense\n.I command\n[options]\n.SH COMMANDS\n";
  for (const Command& command : commands) {
    text += ".SS " + roff(command.name) + "\n" + roff(command.summary) + ".\n.PP\n.B " +
            roff(usage(command)) + "\n";
    for (const Option& option : command.options)
      text += ".TP\n.B " + roff(spelling(option)) + "\n" + roff(option.meaning) +
              (option.required ? " (required)" : "") + "\n";
    if (!command.notes.empty()) text += ".PP\n" + roff(command.notes) + "\n";
  }
  text += ".SH OPTIONS OF EVERY COMMAND\n";
  for (const Option& option : common_options())
    text += ".TP\n.B " + roff(spelling(option)) + "\n" + roff(option.meaning) + "\n";
  text += ".SH EXIT STATUS\n";
  for (const ExitStatus& exit : kExitStatus)
    text += ".TP\n.B " + std::string(exit.status) + "\n" + roff(exit.meaning) + "\n";
  return text + ".SH NOTES\n" + kNoSafety + "\n";
}

std::string bash_completion(std::span<const Command> commands) {
  std::vector<std::string> first = {"help"};
  std::map<std::string, std::vector<std::string>> groups;
  for (const Command& command : commands) {
    const std::size_t blank = command.name.find(' ');
    const std::string head = command.name.substr(0, blank);
    if (std::find(first.begin(), first.end(), head) == first.end()) first.push_back(head);
    if (blank != std::string::npos) groups[head].push_back(command.name.substr(blank + 1));
  }
  std::string text =
      "# Completion of servosense in bash: source it, or put it into bash-completion's folder.\n"
      "_servosense() {\n"
      "  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} words=\n"
      "  COMPREPLY=()\n"
      "  if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
      "    COMPREPLY=($(compgen -W '" +
      joined(first) + " --help --version' -- \"$word\")); return\n  fi\n";
  for (const auto& [head, rest] : groups)
    text += "  if [ \"$COMP_CWORD\" -eq 2 ] && [ \"${COMP_WORDS[1]}\" = " + head +
            " ]; then\n    COMPREPLY=($(compgen -W '" + joined(rest) +
            "' -- \"$word\")); return\n  fi\n";
  // Behind an option that takes a value stands a file name.
  std::vector<std::string> switches;
  text += "  case \"${COMP_WORDS[1]} ${COMP_WORDS[2]}\" in\n";
  for (const Command& command : commands) {
    std::vector<std::string> names;
    for (const Option* option : all_options(command)) {
      names.push_back(option->name);
      if (option->value.empty() &&
          std::find(switches.begin(), switches.end(), option->name) == switches.end())
        switches.push_back(option->name);
    }
    const bool grouped = command.name.find(' ') != std::string::npos;
    text += "    '" + command.name + "'" + (grouped ? "" : "\\ *") + ") words='" + joined(names) +
            "' ;;\n";
  }
  text += "  esac\n  case \"$before\" in\n    ";
  for (std::size_t i = 0; i < switches.size(); ++i) text += (i > 0 ? "|" : "") + switches[i];
  return text +
         ") ;;\n    --*) COMPREPLY=($(compgen -f -- \"$word\")); return ;;\n  esac\n"
         "  if [ \"${word#-}\" != \"$word\" ]; then\n"
         "    COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))\n  else\n"
         "    COMPREPLY=($(compgen -f -- \"$word\"))\n  fi\n}\n"
         "complete -o filenames -F _servosense servosense\n";
}

std::string zsh_completion(std::span<const Command> commands) {
  // In single quotes; a colon or bracket would end what _arguments and _describe take.
  const auto word = [](const std::string& text, const char* special) {
    std::string out;
    for (const char c : text) {
      if (std::string_view(special).find(c) != std::string_view::npos) out += '\\';
      out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    }
    return out;
  };
  std::map<std::string, std::string> first = {{"help", "explains a command"}};
  std::map<std::string, std::vector<const Command*>> groups;
  for (const Command& command : commands) {
    const std::size_t blank = command.name.find(' ');
    const std::string head = command.name.substr(0, blank);
    first[head] = blank == std::string::npos ? command.summary : "";
    if (blank != std::string::npos) groups[head].push_back(&command);
  }
  const auto choice = [&](const std::string& name, const std::string& meaning) {
    return " '" + name + (meaning.empty() ? "" : ":" + word(meaning, ":\\")) + "'";
  };
  std::string text =
      "#compdef servosense\n"
      "# Completion of servosense in zsh: in a folder of $fpath, as _servosense.\n"
      "_servosense() {\n  local -a choices\n  local name=$words[2] taken=1\n"
      "  if (( CURRENT == 2 )); then\n    choices=(";
  for (const auto& [head, meaning] : first) text += choice(head, meaning);
  text += " --help --version)\n    _describe command choices; return\n  fi\n";
  for (const auto& [head, rest] : groups) {
    text +=
        "  if [[ $name == " + head + " ]]; then\n    if (( CURRENT == 3 )); then\n      choices=(";
    for (const Command* command : rest)
      text += choice(command->name.substr(head.size() + 1), command->summary);
    text +=
        ")\n      _describe what choices; return\n    fi\n"
        "    name+=\" $words[3]\" taken=2\n  fi\n";
  }
  text +=
      "  shift taken words; (( CURRENT -= taken ))\n"
      "  case $name in\n";
  for (const Command& command : commands) {
    text += "    '" + command.name + "') _arguments";
    for (const Option* option : all_options(command)) {
      text += " \\\n      '" + option->name + "[" + word(option->meaning, "[]\\") + "]";
      if (!option->value.empty())
        text +=
            ":" + word(option->value, ":\\") + ":" + (option->use == FileUse::none ? "" : "_files");
      text += "'";
    }
    if (!command.operands.empty()) text += " \\\n      '*:file:_files'";
    text += " ;;\n";
  }
  return text + "  esac\n}\n_servosense \"$@\"\n";
}

}  // namespace servosense::cli
