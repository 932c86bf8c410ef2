// Exports of random layout as controls and oscilloscopes write them, with their true map and
// values. Names and units stand here by themselves: nothing of the importer's tables is used.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

namespace import_exports {

inline constexpr double kPi = 3.14159265358979323846;

struct Random {
  std::mt19937_64 engine;
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(engine() % n); }
  bool chance(double p) { return static_cast<double>(engine() >> 11U) * 0x1p-53 < p; }
  double between(double low, double high) {
    return low + (high - low) * static_cast<double>(engine() >> 11U) * 0x1p-53;
  }
  template <typename T>
  const T& of(const std::vector<T>& all) {
    return all[below(all.size())];
  }
};

struct Unit {
  std::string text;  // UTF-8
  double si;         // of one unit
  int digits;        // behind the decimal mark
};

struct Column {
  std::string to;    // "": must stay out
  std::string name;  // heading without its unit
  Unit unit{"", 1, 0};
  bool unit_hidden = false;        // not stated
  std::string stated;              // another unit than the true one
  std::vector<double> si;          // truth
  std::vector<std::string> texts;  // in place of numbers
};

struct Export {
  std::vector<Column> columns;  // without time
  std::string text;             // bytes of the file
  std::vector<double> t_s;
  double t_resolution_s = 0;
  bool ambiguous = false;  // must be asked, unless what is taken is right
  std::string kind;        // what is ambiguous
  std::size_t time_at = 0;
  std::string time_unit;        // to answer with
  std::size_t time_stands = 0;  // row whose time is that of the row before
  char separator = ';';
  bool comma = false;
};

// ---- truth --------------------------------------------------------------------------------------

struct Motion {
  std::vector<double> position, velocity;
};

inline Motion axis_motion(Random& random, std::size_t rows, double dt) {
  Motion m;
  double p = random.between(-0.1, 0.3), v = 0, goal = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    if (i % 40 == 5) goal = random.chance(0.3) ? 0 : random.between(-0.5, 0.5);
    const double before = v;
    v += (goal - v) * 0.15;
    p += 0.5 * (before + v) * (i == 0 ? 0 : dt);
    m.position.push_back(p);
    m.velocity.push_back(v);
  }
  return m;
}

inline std::vector<double> noise(Random& random, std::size_t rows, double middle, double width) {
  std::vector<double> all;
  for (std::size_t i = 0; i < rows; ++i) all.push_back(middle + random.between(-width, width));
  return all;
}

// ---- names --------------------------------------------------------------------------------------

struct Style {
  bool german = false;
  int order = 0;  // how drive and quantity are put together
};

inline std::string joined(Random& random, const Style& style, const std::string& drive,
                          const std::string& quantity) {
  std::string plain = quantity;
  switch (style.order) {
    case 0:
      return quantity + " " + drive;
    case 1:
      return drive + " " + quantity;
    case 2:
      for (char& c : plain)
        if (c == ' ' || c == '-') c = '_';
      return drive + "_" + plain;
    default:
      return random.chance(0.5) ? drive + "." + quantity : drive + ": " + quantity;
  }
}

inline std::string axis_name(Random& random, const Style& style, char letter) {
  const std::string big(1, letter);
  if (style.order >= 2) return random.chance(0.5) ? big + "1" : big;
  return style.german ? random.of<std::string>({big + "-Achse", big, "Achse " + big, big + "1"})
                      : random.of<std::string>({big + "-axis", big, "Axis " + big, big + " axis"});
}

inline std::string spindle_name(Random& random, const Style& style) {
  if (style.order >= 2) return random.of<std::string>({"S1", "Spindle", "SP"});
  return style.german ? random.of<std::string>({"Spindel", "Hauptspindel", "S1"})
                      : random.of<std::string>({"Spindle", "Main spindle", "S1"});
}

inline std::string word(Random& random, const Style& style, const std::string& what) {
  using Words = std::vector<std::string>;
  const bool de = style.german;
  if (what == "position")
    return random.of(
        de ? Words{"Position", "Istposition", "Lageistwert", "Position Ist", "Ist-Position", "Lage"}
           : Words{"position", "Actual position", "ActPos", "pos", "position act"});
  if (what == "velocity")
    return random.of(de ? Words{"Geschwindigkeit", "Istgeschwindigkeit", "Geschw. Ist"}
                        : Words{"velocity", "Actual velocity", "vel", "speed act"});
  if (what == "current")
    return random.of(
        de ? Words{"Strom", "Motorstrom", "Stromistwert", "Iststrom"}
           : Words{"current", "Motor current", "Current feedback", "Iq", "I_q", "CurrentFeedback"});
  if (what == "torque")
    return random.of(de ? Words{"Drehmoment", "Moment", "Momentenistwert"}
                        : Words{"torque", "Actual torque", "Motor torque", "TorqueAct"});
  if (what == "speed")
    return random.of(de ? Words{"Drehzahl", "Istdrehzahl", "Drehzahl Ist"}
                        : Words{"speed", "Actual speed", "speed act", "ActSpeed"});
  if (what == "power")
    return random.of(de ? Words{"Leistung", "Wirkleistung"} : Words{"power", "Active power"});
  if (what == "load") return random.of(de ? Words{"Auslastung"} : Words{"load", "utilization"});
  if (what == "command position")
    return random.of(de ? Words{"Sollposition", "Lagesollwert", "Position Soll"}
                        : Words{"Command position", "position cmd", "Set position"});
  return what;
}

// ---- an export ----------------------------------------------------------------------------------

inline const std::vector<Unit> kPositionUnits = {
    {"mm", 1e-3, 5}, {"m", 1, 8}, {"\xC2\xB5m", 1e-6, 2}};
inline const std::vector<Unit> kVelocityUnits = {
    {"mm/min", 1e-3 / 60, 2}, {"mm/s", 1e-3, 4}, {"m/min", 1.0 / 60, 5}, {"m/s", 1, 7}};
inline const std::vector<Unit> kSpeedUnits = {{"1/min", 2 * kPi / 60, 2},
                                              {"rpm", 2 * kPi / 60, 2},
                                              {"U/min", 2 * kPi / 60, 1},
                                              {"rad/s", 1, 3},
                                              {"\xC2\xB0/s", kPi / 180, 1}};
inline const std::vector<Unit> kCurrentUnits = {{"A", 1, 3}, {"A", 1, 2}, {"mA", 1e-3, 0}};
inline const std::vector<Unit> kTorqueUnits = {{"Nm", 1, 3}, {"Nm", 1, 2}, {"mNm", 1e-3, 0}};

inline void add_drives(Random& random, const Style& style, std::size_t rows, double dt, Export& e) {
  const auto add = [&](const std::string& to, const std::string& drive, const std::string& what,
                       const std::vector<Unit>& units, std::vector<double> si) {
    e.columns.push_back({to,
                         joined(random, style, drive, word(random, style, what)),
                         random.of(units),
                         false,
                         "",
                         std::move(si),
                         {}});
  };
  const std::string letters = "XYZ";
  for (const char letter : letters) {
    if (letter != 'X' && random.chance(0.5)) continue;
    const std::string channel(1, static_cast<char>(letter - 'A' + 'a'));
    const std::string drive = axis_name(random, style, letter);
    const Motion m = axis_motion(random, rows, dt);
    add(channel + ".position_m", drive, "position", kPositionUnits, m.position);
    if (random.chance(0.6))
      add(channel + ".velocity_m_s", drive, "velocity", kVelocityUnits, m.velocity);
    if (random.chance(0.7))
      add(channel + ".current_A", drive, "current", kCurrentUnits, noise(random, rows, 0.5, 6));
    if (random.chance(0.3))
      add(channel + ".torque_Nm", drive, "torque", kTorqueUnits, noise(random, rows, 1, 4));
    if (random.chance(0.3))
      add(channel + ".command_position_m", drive, "command position", kPositionUnits, m.position);
  }
  const std::string spindle = spindle_name(random, style);
  add("spindle.speed_rad_s", spindle, "speed", kSpeedUnits, noise(random, rows, 300, 2));
  if (random.chance(0.6))
    add("spindle.current_A", spindle, "current", kCurrentUnits, noise(random, rows, 12, 3));
  if (random.chance(0.4))
    add("spindle.power_W", spindle, "power", {{"W", 1, 1}, {"kW", 1e3, 4}},
        noise(random, rows, 900, 300));
  if (random.chance(0.4))
    add("spindle.load_percent", spindle, "load", {{"%", 1, 1}}, noise(random, rows, 40, 9));
}

inline void add_decoys(Random& random, std::size_t rows, Export& e) {
  const auto decoy = [&](const std::string& to, const std::string& name, const Unit& unit,
                         double middle, double width) {
    e.columns.push_back({to, name, unit, false, "", noise(random, rows, middle, width), {}});
  };
  if (random.chance(0.4)) decoy("b.current_A", "Strom B-Achse", {"A", 1, 2}, 1, 0.5);
  if (random.chance(0.4))
    decoy("", "Temperatur Schaltschrank",
          {"\xC2\xB0"
           "C",
           1, 1},
          30, 1);
  if (random.chance(0.4))
    decoy("", "Ambient temperature",
          {"\xC2\xB0"
           "C",
           1, 1},
          22, 1);
  if (random.chance(0.4)) decoy("", "Schleppfehler X", {"\xC2\xB5m", 1e-6, 2}, 0, 3e-6);
  if (random.chance(0.3)) decoy("", "X following error", {"mm", 1e-3, 5}, 0, 3e-6);
  if (random.chance(0.3)) decoy("x.command_current_A", "Sollstrom X", {"A", 1, 2}, 0.5, 5);
  if (random.chance(0.3)) decoy("", "Set speed spindle", {"rpm", 2 * kPi / 60, 1}, 310, 0.01);
  if (random.chance(0.3)) decoy("", "Solldrehzahl Spindel", {"1/min", 2 * kPi / 60, 1}, 305, 0.01);
  if (random.chance(0.3)) decoy("", "Coolant pump current", {"A", 1, 2}, 4, 0.1);
  if (random.chance(0.3)) decoy("", "K\xC3\xBChlmitteldruck", {"bar", 1, 2}, 6, 0.2);
  if (random.chance(0.3)) decoy("", "Torque limit X", {"Nm", 1, 1}, 20, 0.01);
  if (random.chance(0.3)) decoy("", "Zwischenkreisspannung", {"V", 1, 1}, 600, 5);
  if (random.chance(0.3)) decoy("", "Tool number", {"", 1, 0}, 7, 0.1);
  if (random.chance(0.3)) {
    Column text{"", random.chance(0.5) ? "Status" : "Operating mode", {"", 1, 0}, true, "", {}, {}};
    for (std::size_t i = 0; i < rows; ++i) text.texts.push_back(i % 7 == 0 ? "HOLD" : "AUTO");
    e.columns.push_back(text);
  }
  if (random.chance(0.15))
    for (int i = 0; i < 150; ++i) decoy("", "Aux " + std::to_string(i), {"", 1, 3}, 5, 5);
  for (std::size_t i = e.columns.size(); i > 1; --i)
    std::swap(e.columns[i - 1], e.columns[random.below(i)]);
}

/// Takes away what the map needs, or says something wrong.
inline void make_ambiguous(Random& random, Export& e) {
  std::vector<std::size_t> drives;
  for (std::size_t i = 0; i < e.columns.size(); ++i)
    if (!e.columns[i].to.empty()) drives.push_back(i);
  Column& c = e.columns[random.of(drives)];
  e.ambiguous = true;
  switch (random.below(8)) {
    case 5:
      e.kind = "time stands";
      e.time_stands = 20 + random.below(60);
      break;
    case 6:
      // Beyond what machines do in the unit that is stated.
      for (const std::size_t i : drives) {
        Column& current = e.columns[i];
        if (current.to.find("current") == std::string::npos) continue;
        e.kind = "beyond";
        for (double& value : current.si) value = value * 20 + 5;
        current.unit = {"mA", 1e-3, 0};
        current.stated = "A";
        return;
      }
      e.kind = "no unit";
      c.unit_hidden = true;
      break;
    case 7:
      e.kind = "no drive";
      c.name = c.to.find("current") != std::string::npos ? "Strom" : "Position";
      break;
    case 0:
      e.kind = "no unit";
      c.unit_hidden = true;
      break;
    case 1: {
      e.kind = "twice";
      Column twin = c;
      twin.to = "";
      for (double& value : twin.si) value *= 0.9;
      e.columns.push_back(twin);
      break;
    }
    case 2:
      e.kind = "numbered axis";
      c.name = "Axis 1 " +
               std::string(c.to.find("position") != std::string::npos ? "position" : "current");
      break;
    case 3:
      e.kind = "unknown unit";
      c.stated = random.of<std::string>({"digits", "p.u.", "LSB"});
      break;
    default:
      // The velocity of an axis with its position beside it, in another unit than stated.
      for (const std::size_t i : drives) {
        Column& v = e.columns[i];
        if (v.to.find("velocity") == std::string::npos) continue;
        e.kind = "contradiction";
        v.stated = v.unit.text == "mm/s" ? "mm/min" : "mm/s";
        return;
      }
      e.kind = "no unit";
      c.unit_hidden = true;
  }
}

inline std::string number(double value, int digits, bool comma, bool thousands) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  std::string out = text;
  const std::size_t point = std::min(out.find('.'), out.size());
  if (comma && point < out.size()) out[point] = ',';
  if (thousands)
    for (std::size_t at = point; at > 3 + (out[0] == '-' ? 1U : 0U);) {
      at -= 3;
      out.insert(at, 1, comma ? '.' : ',');
    }
  return out;
}

inline std::string encoded(const std::string& utf8, int encoding) {
  if (encoding == 0) return utf8;
  if (encoding == 1) return "\xEF\xBB\xBF" + utf8;
  std::string out = encoding == 3 ? "\xFF\xFE" : encoding == 4 ? "\xFE\xFF" : "";
  for (std::size_t i = 0; i < utf8.size(); ++i) {
    unsigned code = static_cast<unsigned char>(utf8[i]);
    if (code >= 0xC0)
      code = ((code & 0x1FU) << 6U) | (static_cast<unsigned char>(utf8[++i]) & 0x3FU);
    const char low = static_cast<char>(code & 0xFFU), high = static_cast<char>(code >> 8U);
    if (encoding == 2)
      out += low;
    else
      out += encoding == 3 ? std::string{low, high} : std::string{high, low};
  }
  return out;
}

struct TimeColumn {
  std::string heading, unit;
  std::vector<std::string> fields;
};

inline TimeColumn time_column(Random& random, const Style& style, double dt, Export& e) {
  TimeColumn time;
  const std::string name =
      random.of<std::string>(style.german ? std::vector<std::string>{"Zeit", "t"}
                                          : std::vector<std::string>{"Time", "time", "t"});
  const std::size_t rows = e.columns[0].si.size();
  const std::size_t form = random.below(7);
  time.heading = name;
  const auto numbers = [&](const std::string& unit, double in_s, int digits, double from) {
    time.unit = unit;
    e.time_unit = unit;
    e.t_resolution_s = 0.51 * in_s * std::pow(10.0, -digits);
    for (std::size_t i = 0; i < rows; ++i)
      time.fields.push_back(
          number(from + static_cast<double>(i) * dt / in_s, digits, e.comma, false));
  };
  const auto clock = [&](std::int64_t start_ms, bool date) {
    for (std::size_t i = 0; i < rows; ++i) {
      const auto us = start_ms * 1000 + std::llround(static_cast<double>(i) * dt * 1e6);
      char text[64];
      const auto s = us / 1000000;
      std::snprintf(text, sizeof text, "%02d:%02d:%02d%c%06d", static_cast<int>(s / 3600 % 24),
                    static_cast<int>(s / 60 % 60), static_cast<int>(s % 60), e.comma ? ',' : '.',
                    static_cast<int>(us % 1000000));
      const int day = 12 + static_cast<int>(s / 86400);
      std::string prefix;
      if (date && style.german) prefix = std::to_string(day) + ".03.2024 ";
      if (date && !style.german) prefix = "2024-03-" + std::to_string(day) + "T";
      time.fields.push_back(prefix + text + (date && !style.german ? "+01:00" : ""));
    }
    e.t_resolution_s = 1e-6;
  };
  switch (form) {
    case 0:
      numbers("s", 1, 6, random.chance(0.3) ? 12.5 : 0);
      break;
    case 1:
      numbers("ms", 1e-3, 3, 0);
      break;
    case 2:
      numbers("us", 1e-6, 0, 0);
      break;
    case 3:
      numbers("s", 1, 6, 1709625600);  // since 1970
      break;
    case 4:
      clock(86399950, false);
      time.heading = style.german ? "Uhrzeit" : "Clock";
      break;
    default:
      clock(static_cast<std::int64_t>(random.below(86400000)), true);
      time.heading = style.german ? "Zeitstempel" : "Timestamp";
  }
  if (e.time_stands > 0) time.fields[e.time_stands] = time.fields[e.time_stands - 1];
  return time;
}

inline std::string heading_of(Random& random, const std::string& name, const std::string& unit,
                              int style) {
  if (unit.empty()) return name;
  if (style == 0) return name + " [" + unit + "]";
  if (style == 1) return name + " (" + unit + ")";
  if (style == 2 && unit.find('/') == std::string::npos) return name + "/" + unit;
  return name + (random.chance(0.5) ? " [" : "[") + unit + "]";
}

inline std::string field_of(const Export& e, const Column& c, std::size_t row, bool thousands) {
  if (!c.texts.empty()) return c.texts[row];
  std::string text = number(c.si[row] / c.unit.si, c.unit.digits, e.comma, thousands);
  const bool quote = text.find(e.separator) != std::string::npos;
  return quote ? "\"" + text + "\"" : text;
}

inline void write_text(Random& random, const Style& style, double dt, Export& e) {
  e.comma = random.chance(0.5);
  e.separator = random.of<char>(e.comma ? std::vector<char>{';', '\t', ';', ','}
                                        : std::vector<char>{',', ';', '\t', '|'});
  TimeColumn time = time_column(random, style, dt, e);
  if (e.ambiguous && random.chance(0.2) && !time.unit.empty()) {
    e.kind += ", no unit of time";
    time.unit = "";
  }
  e.time_at = random.chance(0.8) ? 0 : random.below(e.columns.size());
  const bool unit_line = random.chance(0.25), thousands = random.chance(0.15);
  const bool trailing = random.chance(0.2), comments = random.chance(0.2);
  const bool ragged = random.chance(0.1), line_end = random.chance(0.1);
  const int unit_style = static_cast<int>(random.below(4));
  const std::string end = random.chance(0.5) ? "\r\n" : "\n";
  std::string text;
  for (std::size_t i = random.below(4); i > 0; --i)
    text += random.of<std::string>({"Aufzeichnung 17", "Machine: VMC 850", "Operator;M. Weber",
                                    "Trace created 2024-03-12 08:15:00", ""}) +
            end;
  if (comments) text += "# exported by the control" + end;
  std::string units;
  const auto put_heading = [&](std::string name, const std::string& unit, bool last) {
    std::string heading = unit_line ? name : heading_of(random, name, unit, unit_style);
    if (line_end && random.chance(0.1)) {
      const std::size_t blank = heading.find(' ');
      if (blank != std::string::npos) heading = "\"" + heading.replace(blank, 1, "\n") + "\"";
    } else if (heading.find(e.separator) != std::string::npos)
      heading = "\"" + heading + "\"";
    text += heading + (last ? "" : std::string(1, e.separator));
    units += unit + (last ? "" : std::string(1, e.separator));
  };
  const std::size_t n = e.columns.size();
  for (std::size_t i = 0; i < n; ++i) {
    if (i == e.time_at) put_heading(time.heading, time.unit, false);
    const Column& c = e.columns[i];
    put_heading(c.name, c.unit_hidden ? "" : c.stated.empty() ? c.unit.text : c.stated, i + 1 == n);
  }
  text += (trailing ? std::string(1, e.separator) : "") + end;
  if (unit_line) text += units + (trailing ? std::string(1, e.separator) : "") + end;
  for (std::size_t row = 0; row < e.t_s.size(); ++row) {
    if (comments && row == 30) text += "# a mark" + end;
    for (std::size_t i = 0; i < n; ++i) {
      if (i == e.time_at) {
        const bool quote = time.fields[row].find(e.separator) != std::string::npos;
        text += (quote ? "\"" + time.fields[row] + "\"" : time.fields[row]) + e.separator;
      }
      // Now and then a value is missing.
      std::string field = field_of(e, e.columns[i], row, thousands);
      if (e.columns[i].texts.empty() && random.chance(0.004)) {
        field = random.of<std::string>({"", "NaN", "n/a", "---"});
        e.columns[i].si[row] = std::nan("");
      }
      text += field + (i + 1 == n ? "" : std::string(1, e.separator));
    }
    text += (trailing ? std::string(1, e.separator) : "") + end;
    if (ragged && row == 60) text += "recording paused" + end;
  }
  e.text = encoded(text, static_cast<int>(random.below(5)));
}

inline Export make_export(std::uint64_t seed) {
  Random random{std::mt19937_64(seed)};
  Export e;
  const Style style{random.chance(0.5), static_cast<int>(random.below(4))};
  const std::size_t rows = 120 + random.below(200);
  const double dt = random.of<double>({0.001, 0.002, 0.004, 0.01, 0.0005});
  for (std::size_t i = 0; i < rows; ++i) e.t_s.push_back(static_cast<double>(i) * dt);
  add_drives(random, style, rows, dt, e);
  add_decoys(random, rows, e);
  if (random.chance(0.35)) make_ambiguous(random, e);
  for (Column& c : e.columns)
    if (c.si.empty()) c.si.assign(rows, 0);
  write_text(random, style, dt, e);
  return e;
}

}  // namespace import_exports
