// LinuxCNC's standalone interpreter as the oracle: what `rs274` prints for a program, beside what
// the reader makes of it.
//
// It prints four decimals in millimetres or inches, so an end point is compared to half a unit of
// the last one: 0.05 um in mm, 1.3 um in inches.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "servosense/process/program/program_reader.hpp"

namespace rs274 {

namespace fs = std::filesystem;
using servosense::process::CanonicalMove;
using Kind = CanonicalMove::Kind;

/// A step, lengths in mm.
struct Step {
  Kind kind = Kind::rapid;
  std::string n_word;           // of its block, "" without one
  std::array<double, 6> end{};  // x y z a b c
  std::array<double, 2> centre{};
  int turns = 0;
  double feed_mm_min = 0;    // in force
  double value = 0;          // dwell [s], tool, direction of the spindle, M of a stop
  double unit_mm = 1;        // in which it was printed
  bool synchronous = false;  // G95 or with the spindle: the feed is not one of time
};

struct Outcome {
  std::vector<Step> steps;
  bool failed = false;
  std::string message, line;  // of the error, and the text of the block
};

inline bool installed() { return std::system("command -v rs274 >/dev/null 2>&1") == 0; }

inline std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline std::vector<double> numbers(const std::string& text) {
  std::vector<double> all;
  std::string plain = text;
  std::replace(plain.begin(), plain.end(), ',', ' ');
  std::istringstream in(plain);
  for (double v = 0; in >> v;) all.push_back(v);
  return all;
}

/// Runs `program` (a path) in its folder; `folder` takes what it prints. `tools` of .tbl form has
/// lengths in inches, because `rs274` without a machine has those units.
inline Outcome run(const fs::path& program, const fs::path& folder, const fs::path& tools,
                   bool block_delete = false) {
  const fs::path out = folder / "rs274.out", err = folder / "rs274.err";
  const fs::path empty = folder / "rs274.var";
  std::ofstream(empty).close();
  const std::string command = "cd '" + program.parent_path().string() + "' && timeout 20 rs274 -g" +
                              (block_delete ? " -b" : "") + " -v '" + empty.string() + "' -t '" +
                              tools.string() + "' '" + program.filename().string() + "' >'" +
                              out.string() + "' 2>'" + err.string() + "' </dev/null";
  const int status = std::system(command.c_str());
  Outcome outcome;
  outcome.failed = !(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  std::istringstream errors(content(err));
  std::vector<std::string> said;
  for (std::string line; std::getline(errors, line);)
    if (line != "executing") said.push_back(line);
  if (outcome.failed && said.size() >= 2) {
    outcome.line = said.back();
    outcome.message = said[said.size() - 2];
  }
  std::istringstream in(content(out));
  double unit = 1, feed = 0;
  bool per_turn = false, with_spindle = false;
  std::string plane = "XY";
  int direction = 0;
  for (std::string line; std::getline(in, line);) {
    const std::size_t open = line.find('('), close = line.rfind(')');
    std::istringstream head(line.substr(0, open));
    std::string count, n, name;
    head >> count >> n >> name;
    if (open == std::string::npos || close == std::string::npos || n.empty() || n[0] != 'N')
      continue;
    const std::string inner = line.substr(open + 1, close - open - 1);
    const std::vector<double> v = numbers(inner);
    Step step;
    step.n_word = n.find('.') == std::string::npos ? n : "";
    step.unit_mm = unit;
    step.feed_mm_min = feed;
    step.synchronous = per_turn || with_spindle;
    const auto put = [&](Kind kind, double value = 0) {
      step.kind = kind;
      step.value = value;
      outcome.steps.push_back(step);
    };
    const auto point = [&](std::initializer_list<double> values) {
      std::copy(values.begin(), values.end(), step.end.begin());
      for (std::size_t i = 0; i < 3; ++i) step.end[i] *= unit;
    };
    if (name == "USE_LENGTH_UNITS") {
      unit = inner.ends_with("INCHES") ? 25.4 : 1;
    } else if (name == "SELECT_PLANE") {
      plane = inner.substr(inner.size() - 2);
    } else if (name == "SET_FEED_RATE") {
      feed = v.at(0) * unit;  // of the unit at that time
    } else if (name == "SET_FEED_MODE") {
      per_turn = v.at(1) != 0;
    } else if (name == "START_SPEED_FEED_SYNC") {
      with_spindle = true;
    } else if (name == "STOP_SPEED_FEED_SYNCH") {
      with_spindle = false;
    } else if (name == "STRAIGHT_TRAVERSE" || name == "STRAIGHT_FEED") {
      point({v.at(0), v.at(1), v.at(2), v.at(3), v.at(4), v.at(5)});
      put(name == "STRAIGHT_FEED" ? Kind::feed : Kind::rapid);
    } else if (name == "ARC_FEED") {
      if (plane == "XY") point({v.at(0), v.at(1), v.at(5), v.at(6), v.at(7), v.at(8)});
      if (plane == "XZ") point({v.at(1), v.at(5), v.at(0), v.at(6), v.at(7), v.at(8)});
      if (plane == "YZ") point({v.at(5), v.at(0), v.at(1), v.at(6), v.at(7), v.at(8)});
      step.centre = {v.at(2) * unit, v.at(3) * unit};
      step.turns = static_cast<int>(v.at(4));
      put(Kind::arc);
    } else if (name == "RIGID_TAP") {
      point({v.at(0), v.at(1), v.at(2)});
      put(Kind::tap);
    } else if (name == "DWELL") {
      put(Kind::dwell, v.at(0));
    } else if (name == "CHANGE_TOOL" || name == "CHANGE_TOOL_NUMBER") {
      direction = name == "CHANGE_TOOL" ? 0 : direction;
      put(Kind::tool, v.at(0));
    } else if (name.starts_with("START_SPINDLE")) {
      put(Kind::spindle, name.ends_with("COUNTERCLOCKWISE") ? -1 : 1);
    } else if (name == "PROGRAM_STOP" || name == "OPTIONAL_PROGRAM_STOP") {
      put(Kind::stop);
    } else if (name == "PROGRAM_END" || name == "FINISH") {
      put(Kind::end);
    }
  }
  return outcome;
}

/// What the reader makes of the same, as steps of the same kinds.
struct Ours {
  std::vector<CanonicalMove> moves;
  bool failed = false;
  std::string message;
  std::size_t line = 0;
  std::string line_text;
};

inline Ours ours(const servosense::process::ProgramText& text,
                 const servosense::process::ProgramOptions& options) {
  Ours o;
  servosense::process::ProgramPlace place;
  const auto done = servosense::process::run_program(
      text, options,
      [&](const CanonicalMove& move) {
        const bool starts = move.kind == Kind::spindle && (move.number == 3 || move.number == 4);
        if (is_motion(move.kind) || starts || move.kind == Kind::dwell || move.kind == Kind::tool ||
            move.kind == Kind::stop || move.kind == Kind::end)
          o.moves.push_back(move);
      },
      &place);
  o.failed = !done.has_value();
  if (done) return o;
  o.message = done.error().sentence;
  o.line = place.line;
  if (place.file == text.name() && place.line <= text.lines().size() && place.line > 0)
    o.line_text = text.lines()[place.line - 1];
  return o;
}

inline std::string described(const Step& s) {
  std::ostringstream out;
  out << kind_name(s.kind) << ' ' << s.n_word;
  for (const double e : s.end) out << ' ' << e;
  out << " centre " << s.centre[0] << ' ' << s.centre[1] << " turns " << s.turns << " feed "
      << s.feed_mm_min << " value " << s.value;
  return out.str();
}

/// What differs at the first place where something does, "" when all is alike.
inline std::string difference(const Outcome& theirs, const Ours& mine,
                              const std::vector<std::string>& lines, bool before_refusal = false) {
  const std::size_t n = std::min(theirs.steps.size(), mine.moves.size());
  // With cutter compensation a move goes out with the block that ends it, and with its number.
  bool compensates = false;
  for (std::string text : lines) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    compensates = compensates || text.find("g41") != std::string::npos ||
                  text.find("g42") != std::string::npos;
  }
  for (std::size_t i = 0; i < n; ++i) {
    const Step& t = theirs.steps[i];
    const CanonicalMove& m = mine.moves[i];
    Step s;
    s.kind = m.kind;
    // Half of the last decimal, and rounding of numbers that have gone another way.
    const double close = 0.5001e-4 * t.unit_mm + 1e-9;
    bool same = t.kind == m.kind;
    for (std::size_t k = 0; k < 6; ++k) s.end[k] = m.end[k] * (k < 3 ? 1000 : 1);
    if (is_motion(m.kind))
      for (std::size_t k = 0; k < (m.kind == Kind::tap ? 3U : 6U); ++k)
        same = same && std::abs(s.end[k] - t.end[k]) <=
                           (k < 3 ? close : 0.5001e-4) + 1e-12 * std::abs(t.end[k]);
    if (m.kind == Kind::arc) {
      s.centre = {m.centre_m[0] * 1000, m.centre_m[1] * 1000};
      s.turns = m.turns;
      same = same && s.turns == t.turns;
      for (std::size_t k = 0; k < 2; ++k)
        same = same && std::abs(s.centre[k] - t.centre[k]) <= close + 1e-12 * std::abs(t.centre[k]);
    }
    if ((m.kind == Kind::feed || m.kind == Kind::arc) && !t.synchronous) {
      s.feed_mm_min = m.feed_m_s * 60000;
      // Under G20 with axes that turn alone the number is degrees.
      const bool degrees = m.feed_deg_s != 0;
      if (!degrees)
        same = same && std::abs(s.feed_mm_min - t.feed_mm_min) <= close + 1e-9 * t.feed_mm_min;
    }
    if (m.kind == Kind::dwell)
      s.value = m.seconds, same = same && std::abs(s.value - t.value) <= 0.5001e-4;
    if (m.kind == Kind::tool) s.value = m.tool, same = same && s.value == t.value;
    if (m.kind == Kind::spindle)
      s.value = m.number == 3 ? 1 : -1, same = same && s.value == t.value;
    if (same && !compensates && !t.n_word.empty() && m.line <= lines.size() && m.line > 0) {
      // The block of the same number.
      std::string digits;
      for (const char c : lines[m.line - 1])
        if (std::isdigit(static_cast<unsigned char>(c)) != 0)
          digits += c;
        else if (!digits.empty())
          break;
      same = "N" + digits == t.n_word;
    }
    if (!same)
      return "step " + std::to_string(i) + ", line " + std::to_string(m.line) + " '" +
             (m.line > 0 && m.line <= lines.size() ? lines[m.line - 1] : "") +
             "': " + described(s) + "; rs274: " + described(t);
  }
  if (before_refusal && mine.failed && theirs.steps.size() >= mine.moves.size()) return "";
  if (theirs.failed != mine.failed)
    return mine.failed ? "refused: " + mine.message
                       : "rs274 refuses '" + theirs.line + "': " + theirs.message;
  if (mine.failed) {
    // What is missing is told where it is asked for, rs274 tells the last line of the file.
    const bool sought =
        theirs.message.starts_with("EOF in file") || theirs.message.starts_with("File ended");
    const auto trimmed = [](std::string s) {
      while (!s.empty() && std::isspace(static_cast<unsigned char>(s.back())) != 0) s.pop_back();
      return s;
    };
    if (!sought && trimmed(mine.line_text) != trimmed(theirs.line))
      return "refused '" + mine.line_text + "' (" + mine.message + "), rs274 '" + theirs.line +
             "' (" + theirs.message + ")";
    // Of the block that is refused some moves may have gone out.
    if (!mine.moves.empty() && n < mine.moves.size() && mine.moves[n].line != mine.line)
      return "moves after the end of rs274's, from line " + std::to_string(mine.moves[n].line);
    return "";
  }
  if (theirs.steps.size() != mine.moves.size())
    return std::to_string(mine.moves.size()) + " steps, rs274 " +
           std::to_string(theirs.steps.size()) +
           (mine.failed ? "; " + mine.message + " / " + theirs.message : "");
  return "";
}

}  // namespace rs274
