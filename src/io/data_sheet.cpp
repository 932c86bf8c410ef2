#include "servosense/io/data_sheet.hpp"

#include <algorithm>
#include <cstdio>
#include <set>
#include <utility>

#include "servosense/io/machine_classes.hpp"
#include "servosense/io/sheet_figures.hpp"
#include "servosense/io/sheet_value.hpp"
#include "servosense/io/text.hpp"
#include "sheet_drive.hpp"

namespace servosense {
namespace {

std::string dotted(std::string_view section, std::string_view name) {
  return std::string(section) + "." + std::string(name);
}

bool is_one_number(const MachineKey& key) {
  return key.kind == KeyKind::number || key.kind == KeyKind::integer;
}

/// A figure or the sentence that says why it is none.
Expected<GivenFigure> figure_from(const SheetEntry& entry) {
  const std::string where = printable(dotted(entry.section, entry.name));
  if (section_families(entry.section).empty())
    return usage_error(where + ": unknown section " + in_quotes("[" + entry.section + "]") +
                       "; the nearest known one is [" + nearest_section(entry.section) + "]");
  GivenFigure figure;
  figure.key = find_sheet_key(entry.section, entry.name);
  if (figure.key == nullptr)
    return usage_error(where + ": unknown key " + in_quotes(entry.name) + " in [" + entry.section +
                       "]; the nearest known one is '" +
                       nearest_sheet_key(entry.section, entry.name) + "'");
  const MachineKey& key = *figure.key;
  figure.said = trim(entry.text);
  figure.written = figure.said;
  if (figure.said.empty())
    return usage_error(where + " has no value; expected " + expectation(key));
  if (figure.said.find('#') != std::string::npos)
    return usage_error(where + ": '#' begins a comment in a machine file; leave it out");
  const auto number_of = [&](std::string_view text) -> Expected<SheetValue> {
    auto value = sheet_value_from(text, key.unit, is_per_turn(key));
    if (value) return value;
    return usage_error(where + ": expected " + expectation(key) +
                       (key.unit.empty() ? "" : ", or another unit of that kind") + ", found " +
                       in_quotes(text) + "; " + value.error().sentence);
  };
  if (is_one_number(key)) {
    const auto value = number_of(figure.said);
    if (!value) return value.error();
    figure.value = value->value;
    figure.written = number_text(value->value);
    figure.amplitude = value->amplitude;
    figure.remark = value->remark;
  } else if (key.kind == KeyKind::list) {
    figure.written.clear();
    for (std::string_view rest = figure.said;;) {
      const std::size_t comma = rest.find(',');
      const auto value = number_of(trim(rest.substr(0, comma)));
      if (!value) return value.error();
      figure.written += (figure.written.empty() ? "" : ", ") + number_text(value->value);
      if (comma == std::string_view::npos) break;
      rest.remove_prefix(comma + 1);
    }
  }
  if (const std::string fault = value_fault(key, figure.written); !fault.empty())
    return usage_error(where + ": " + fault +
                       (figure.written == figure.said ? "" : " (given: " + figure.said + ")"));
  return figure;
}

/// What is worked out ends in rounding errors beyond these.
std::string twelve_digits(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.12g", value);
  return text;
}

/// Power of the ampere in the unit of a key.
int ampere_power(const MachineKey& key) {
  const auto units = unit_expressions(key.unit);
  return units.empty() ? 0 : units[0].powers[3];
}

/// Place of a section or key in the table of keys, which is the order of the file.
std::size_t key_place(const MachineKey* key) {
  return static_cast<std::size_t>(key - machine_keys().data());
}
std::size_t section_place(const std::string& section) {
  std::size_t first = machine_keys().size();
  for (const std::string& family : section_families(section))
    for (const MachineKey& key : machine_keys())
      if (key.family == family) first = std::min(first, key_place(&key));
  return first;
}

void sort_sections(std::vector<std::string>& sections) {
  std::sort(sections.begin(), sections.end(), [](const std::string& a, const std::string& b) {
    return std::pair(section_place(a), std::string_view(a)) <
           std::pair(section_place(b), std::string_view(b));
  });
}

class SheetWork {
 public:
  SheetWork(std::span<const SheetEntry> entries, std::string_view machine_class)
      : class_(machine_class) {
    read(entries);
  }

  SheetReport finish(const std::string& name) {
    note_class();
    for (const auto& [section, figures] : figures_) {
      contradictions(section, figures);
      if (drive_kind(section) != DriveKind::none) take_drive(section, figures);
    }
    if (told_.empty() && class_.empty())
      out_.faults.push_back(
          "nothing is known of the machine; give figures with --set, or a class, or answer on a "
          "terminal");
    else if (drives().empty())
      out_.remarks.push_back(
          "no drive is known, so none can be watched; give figures of [spindle] or of an axis");
    take_given();
    guess();
    write(name);
    if (!out_.faults.empty()) return std::move(out_);
    find_missing();
    return std::move(out_);
  }

 private:
  struct Key {
    std::string written;
    std::string comment;
  };

  void read(std::span<const SheetEntry> entries) {
    for (const SheetEntry& entry : entries) {
      told_.insert(dotted(entry.section, entry.name));
      auto figure = figure_from(entry);
      if (!figure) {
        out_.faults.push_back(figure.error().sentence);
        continue;
      }
      if (!figures_[entry.section].emplace(entry.name, std::move(*figure)).second)
        out_.faults.push_back(dotted(entry.section, entry.name) +
                              " is given twice; keep one of them");
    }
  }

  void note_class() {
    if (class_.empty()) return;
    const auto classes = machine_classes();
    if (std::any_of(classes.begin(), classes.end(),
                    [&](const MachineClass& c) { return c.name == class_; }))
      return;
    std::vector<std::string_view> names;
    std::string all;
    for (const MachineClass& c : classes) {
      names.push_back(c.name);
      all += (all.empty() ? "" : ", ") + std::string(c.name);
    }
    out_.faults.push_back("unknown class " + in_quotes(class_) + "; the nearest known one is '" +
                          std::string(nearest_name(class_, names)) + "' of " + all);
  }

  void contradictions(const std::string& section, const GivenFigures& figures) {
    for (const KeyAlternatives& either : key_alternatives())
      if (section.starts_with(either.prefix) && figures.contains(either.first) &&
          figures.contains(either.second))
        out_.faults.push_back("[" + section + "] is given both '" + std::string(either.first) +
                              "' and '" + std::string(either.second) +
                              "', which may contradict each other; keep one");
    const char* const constant = "torque_constant_Nm_per_A";
    if (drive_kind(section) == DriveKind::linear && figures.contains(constant) &&
        !told_.contains(dotted(section, "lead_m")))
      out_.faults.push_back(dotted(section, constant) + " needs " + dotted(section, "lead_m") +
                            ": without it no command reads the file; give the travel per turn");
  }

  void take_drive(const std::string& section, const GivenFigures& figures) {
    DerivedDrive derived = derive_drive(section, figures);
    for (const DerivedKey& key : derived.keys) {
      const std::string digits = twelve_digits(key.value);
      const MachineKey* const known = find_machine_key(section, key.key);
      if (known == nullptr) continue;
      if (const std::string fault = value_fault(*known, digits); !fault.empty())
        out_.faults.push_back(dotted(section, key.key) + ", worked out from " + key.from + ": " +
                              fault);
      keys_[section][key.key] = {digits, "from " + key.from};
      out_.derived.push_back({section, key.key, digits, std::string(known->unit), true, key.from});
    }
    std::move(derived.remarks.begin(), derived.remarks.end(), std::back_inserter(out_.remarks));
    std::move(derived.faults.begin(), derived.faults.end(), std::back_inserter(out_.faults));
  }

  /// The drive that a section belongs to: [axis.x] of [controller.x].
  [[nodiscard]] Amplitude reported_for(const std::string& section) const {
    for (const auto& [drive, figures] : figures_)
      if (drive_kind(drive) != DriveKind::none && drive_of(drive) == drive_of(section))
        return reported_amplitude(figures);
    return Amplitude::unsaid;
  }

  void take_given() {
    for (const auto& [section, figures] : figures_)
      for (const auto& [name, figure] : figures) {
        SheetReport::Value value{section,
                                 name,
                                 figure.written,
                                 std::string(figure.key->unit),
                                 is_one_number(*figure.key),
                                 figure.said};
        if (!figure.remark.empty()) value.from += " (" + figure.remark + ")";
        out_.given.push_back(value);
        if (find_machine_key(section, name) == nullptr) continue;
        Key key{figure.written, value.from == figure.written ? "given" : "given: " + value.from};
        if (figure.amplitude != Amplitude::unsaid) take_current(section, name, figure, key);
        keys_[section][name] = key;
      }
  }

  /// A figure per effective or peak ampere, as a trace tells the current.
  void take_current(const std::string& section, const std::string& name, const GivenFigure& figure,
                    Key& key) {
    const int power = ampere_power(*figure.key);
    if (power == 0) return;
    const Amplitude reported = reported_for(section);
    if (reported == Amplitude::unsaid) {
      out_.remarks.push_back(amplitude_remark(section, name, figure.amplitude));
      return;
    }
    const double factor = amplitude_factor(figure.amplitude, reported, power);
    if (factor == 1) return;
    const std::string digits = twelve_digits(figure.value * factor);
    const bool peak = reported == Amplitude::peak;
    const std::string from = figure.said + ", for " + (peak ? "peak" : "effective") + " amperes";
    key = {digits, "from " + from};
    out_.derived.push_back({section, name, digits, std::string(figure.key->unit), true, from});
  }

  void guess() {
    for (const TypicalValue& typical : typical_values()) {
      const std::string section(typical.section), name(typical.key);
      if (typical.machine_class != class_ || keys_[section].contains(name)) continue;
      const std::string written = number_text(typical.value);
      keys_[section][name] = {written, "guess: typical of " + std::string(class_) +
                                           "; 'servosense identify idle' replaces it"};
      out_.guessed.push_back({section, name, written,
                              std::string(find_machine_key(section, name)->unit), true,
                              std::string(typical.source)});
    }
  }

  [[nodiscard]] std::vector<std::string> sections() const {
    std::vector<std::string> all;
    for (const auto& [section, keys] : keys_) all.push_back(section);
    sort_sections(all);
    return all;
  }

  /// Sections that hold a drive, by what is given or typical of the class.
  [[nodiscard]] std::vector<std::string> drives() const {
    std::vector<std::string> all;
    const auto add = [&](const std::string& section) {
      if (drive_kind(section) != DriveKind::none &&
          std::find(all.begin(), all.end(), section) == all.end())
        all.push_back(section);
    };
    for (const auto& [section, figures] : figures_) add(section);
    for (const TypicalValue& typical : typical_values())
      if (typical.machine_class == class_) add(std::string(typical.section));
    return all;
  }

  void write(const std::string& name) {
    MachineFile machine = *MachineFile::parse("# From a data sheet, by 'servosense init'.\n", name);
    for (const std::string& section : sections()) {
      std::vector<std::pair<std::size_t, std::string>> order;
      for (const auto& [key, value] : keys_.at(section))
        order.emplace_back(key_place(find_machine_key(section, key)), key);
      std::sort(order.begin(), order.end());
      for (const auto& [at, key] : order) {
        const Key& value = keys_.at(section).at(key);
        machine.set(section, key, std::string_view(value.written), value.comment);
      }
    }
    sort_values(out_.given);
    sort_values(out_.derived);
    sort_values(out_.guessed);
    if (!out_.faults.empty()) return;
    // What the tables above let through is found by the reader of the file.
    auto checked = MachineFile::parse(machine.text(), name);
    if (checked)
      out_.machine = std::move(*checked);
    else
      out_.faults.push_back(checked.error().sentence);
  }

  static void sort_values(std::vector<SheetReport::Value>& values) {
    std::stable_sort(values.begin(), values.end(), [](const auto& a, const auto& b) {
      return std::pair(section_place(a.section), a.section) <
             std::pair(section_place(b.section), b.section);
    });
  }

  void find_missing() {
    const MachineFile& machine = out_.machine;
    std::vector<std::string> all = drives();
    all.emplace_back("machine");
    if (machine.has_section("spindle")) all.emplace_back("tool");
    sort_sections(all);
    for (const std::string& section : all)
      for (const NeededKey& needed : needed_keys()) {
        if (!means_section(needed.section, section) ||
            find_machine_key(section, needed.key) == nullptr || machine.has(section, needed.key) ||
            !matters(section, needed.key) || is_told(section, needed.key))
          continue;
        std::string costs(needed.costs), drive(drive_of(section));
        if (drive.starts_with("spindle")) drive = "the " + drive;
        for (std::size_t at; (at = costs.find("{drive}")) != std::string::npos;)
          costs.replace(at, 7, drive);
        out_.missing.push_back({section, std::string(needed.key), costs});
      }
  }

  [[nodiscard]] bool is_told(const std::string& section, std::string_view key) const {
    return std::any_of(
        out_.missing.begin(), out_.missing.end(),
        [&](const SheetReport::Missing& m) { return m.section == section && m.key == key; });
  }

  /// Some keys matter beside others only.
  [[nodiscard]] bool matters(const std::string& section, std::string_view key) const {
    const MachineFile& machine = out_.machine;
    if (key == "counter_bits") return machine.has(section, "encoder_counts_per_rev");
    if (key == "moving_mass_kg") return machine.flag(section, "vertical").value_or(false);
    if (key == "diameter_m") return machine.has_section("axis.x") || machine.has_section("axis.y");
    if (key == "torque_constant_Nm_per_A") return !machine.has(section, "force_constant_N_per_A");
    return true;
  }

  std::string_view class_;
  std::set<std::string> told_;                              // right or wrong
  std::map<std::string, GivenFigures> figures_;             // as given
  std::map<std::string, std::map<std::string, Key>> keys_;  // as written
  SheetReport out_;
};

}  // namespace

Expected<SheetEntry> sheet_entry_from(std::string_view text) {
  const std::size_t equals = text.find('=');
  const std::string_view name = trim(text.substr(0, equals));
  const std::size_t dot = name.rfind('.');
  if (equals == std::string_view::npos || dot == std::string_view::npos || dot == 0 ||
      dot + 1 == name.size())
    return usage_error("expected SECTION.KEY=VALUE, like axis.x.lead_m=10mm, found " +
                       in_quotes(text));
  return SheetEntry{std::string(name.substr(0, dot)), std::string(name.substr(dot + 1)),
                    std::string(trim(text.substr(equals + 1)))};
}

std::string sheet_fault(const SheetEntry& entry) {
  const auto figure = figure_from(entry);
  return figure ? "" : figure.error().sentence;
}

SheetReport work_out(std::span<const SheetEntry> entries, std::string_view machine_class,
                     const std::string& machine) {
  return SheetWork(entries, machine_class).finish(machine);
}

}  // namespace servosense
