#include "init_questions.hpp"

#include <algorithm>
#include <istream>
#include <optional>
#include <ostream>
#include <sstream>

#include "servosense/core/channel.hpp"
#include "servosense/io/machine_classes.hpp"
#include "servosense/io/sheet_figures.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

/// Sections of all drives that a machine file may hold.
std::vector<std::string> drive_sections() {
  std::vector<std::string> all;
  for (const std::string_view channel : kChannelNames)
    for (const std::string& section : {std::string(channel), "axis." + std::string(channel)})
      if (drive_kind(section) != DriveKind::none) all.push_back(section);
  return all;
}

std::string names_of(const std::vector<std::string>& sections) {
  std::string text;
  for (const std::string& section : sections)
    text += (text.empty() ? "" : " ") + std::string(drive_of(section));
  return text;
}

class SheetDialogue {
 public:
  SheetDialogue(std::istream& in, std::ostream& out, SheetAnswers known)
      : in_(in), out_(out), answers_(std::move(known)) {}

  SheetAnswers run() {
    out_ << "Enter leaves a figure out. Another unit may be given behind a number.\n";
    if (answers_.machine_class.empty()) ask_class();
    std::vector<std::string> sections = ask_drives();
    const bool spindle = std::find(sections.begin(), sections.end(), "spindle") != sections.end();
    sections.insert(sections.begin(), "machine");
    if (spindle) sections.emplace_back("tool");
    for (const std::string& section : sections)
      for (const SheetQuestion& question : sheet_questions())
        if (means_section(question.section, section) && is_open(section, question))
          ask_figure(section, question);
    return std::move(answers_);
  }

 private:
  /// The answer; nothing for none, or at the end.
  std::optional<std::string> answer(const std::string& question) {
    if (!in_) return std::nullopt;
    out_ << question << ": " << std::flush;
    std::string line;
    if (!std::getline(in_, line)) {
      out_ << '\n';
      return std::nullopt;
    }
    line = std::string(trim(line));
    return line.empty() ? std::nullopt : std::optional(line);
  }

  void ask_class() {
    std::string names;
    const auto classes = machine_classes();
    for (const MachineClass& c : classes)
      names += (names.empty() ? "" : ", ") + std::string(c.name);
    const auto given = [&] {
      return answer(
          "class of the machine, whose typical inertia and friction stand in for what no "
          "sheet gives (" +
          names + "; Enter: guess nothing)");
    };
    while (const auto name = given()) {
      const bool known = std::any_of(classes.begin(), classes.end(),
                                     [&](const MachineClass& c) { return c.name == *name; });
      if (known) {
        answers_.machine_class = *name;
        return;
      }
      out_ << "  " << in_quotes(*name) << " is none of them\n";
    }
  }

  std::vector<std::string> ask_drives() {
    const std::vector<std::string> all = drive_sections();
    const std::vector<std::string> usual = {"spindle", "axis.x", "axis.y", "axis.z"};
    while (const auto line =
               answer("its drives, of " + names_of(all) + " (Enter: " + names_of(usual) + ")")) {
      std::vector<std::string> chosen;
      std::string unknown;
      std::istringstream words(*line);
      for (std::string word; words >> word;) {
        while (word.ends_with(',')) word.pop_back();
        const auto at = std::find_if(all.begin(), all.end(), [&](const std::string& section) {
          return drive_of(section) == word || section == word;
        });
        if (at == all.end())
          unknown = word;
        else if (std::find(chosen.begin(), chosen.end(), *at) == chosen.end())
          chosen.push_back(*at);
      }
      if (unknown.empty() && !chosen.empty()) return chosen;
      out_ << "  " << in_quotes(unknown) << " is none of them\n";
    }
    return usual;
  }

  [[nodiscard]] bool is_given(const std::string& section, std::string_view name) const {
    return std::any_of(answers_.entries.begin(), answers_.entries.end(),
                       [&](const SheetEntry& e) { return e.section == section && e.name == name; });
  }

  [[nodiscard]] bool is_open(const std::string& section, const SheetQuestion& question) const {
    if (find_sheet_key(section, question.name) == nullptr) return false;
    const bool known = is_given(section, question.name) ||
                       (!question.unless.empty() && is_given(section, question.unless));
    return !known && (question.after.empty() || is_given(section, question.after));
  }

  void ask_figure(const std::string& section, const SheetQuestion& question) {
    const std::string words =
        section + ": " + std::string(question.words) +
        (question.unit.empty() ? "" : " [" + std::string(question.unit) + "]");
    while (const auto text = answer(words)) {
      SheetEntry entry{section, std::string(question.name), *text};
      if (parse_number(*text).ok() && !question.unit.empty())
        entry.text += " " + std::string(question.unit);
      const std::string fault = sheet_fault(entry);
      if (fault.empty()) {
        answers_.entries.push_back(std::move(entry));
        return;
      }
      out_ << "  " << fault << '\n';
    }
  }

  std::istream& in_;
  std::ostream& out_;
  SheetAnswers answers_;
};

}  // namespace

SheetAnswers ask_sheet(std::istream& in, std::ostream& out, const std::string& machine_class) {
  return SheetDialogue(in, out, {{}, machine_class}).run();
}

}  // namespace servosense::cli
