// What a person sees: on a terminal of 80 and of 120 columns no line runs over and columns stay
// columns; in a pipe every row is one line, word for word the same. Nothing that a file is called
// reaches a terminal as an escape.
#include <fcntl.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "program.hpp"

namespace {

using namespace program_test;

const std::string kMoves =
    "x limits 0.5 5 100\nx move 0.1 0.2\nx move 0 0.2\nx move 0.05 0.05\nx move 0 0.05\n"
    "x move 0.1 0.2\nx move 0 0.2\n";

/// Runs the program with a terminal of so many columns as standard output, and also as standard
/// error when `error` says so.
Outcome on_terminal(const std::string& arguments, unsigned columns, bool error = false) {
  Outcome o;
  o.command = "servosense " + arguments + " at " + std::to_string(columns) + " columns";
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY);
  CHECK(terminal >= 0 && grantpt(terminal) == 0 && unlockpt(terminal) == 0);
  const std::string name = ptsname(terminal);
  const winsize size{24, static_cast<unsigned short>(columns), 0, 0};
  CHECK(ioctl(terminal, TIOCSWINSZ, &size) == 0);
  const std::string line = "cd '" + folder.string() + "' && '" + program + "' " + arguments +
                           " > " + name + " 2> " + (error ? name : "err.txt") + " < /dev/null";
  // Held open, so that what was written does not go with its writer.
  const int writer = ::open(name.c_str(), O_RDWR | O_NOCTTY);
  std::thread reader([&] {
    char bytes[4096];
    for (;;) {
      const ssize_t n = ::read(terminal, bytes, sizeof bytes);
      if (n <= 0) return;
      o.out.append(bytes, static_cast<std::size_t>(n));
      if (o.out.ends_with("end of output\r\n")) return;
    }
  });
  const int raw = std::system(line.c_str());
  CHECK(::write(writer, "end of output\n", 14) == 14);
  reader.join();
  ::close(writer);
  ::close(terminal);
  o.status = WIFEXITED(raw) ? WEXITSTATUS(raw) : -1;
  o.out.erase(o.out.rfind("end of output"));
  std::erase(o.out, '\r');
  return o;
}

std::size_t columns_of(const std::string& line) {
  return static_cast<std::size_t>(
      std::count_if(line.begin(), line.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string without_blanks(std::string text) {
  std::erase_if(text, [](char c) { return c == ' ' || c == '\n'; });
  return text;
}

/// Names of files are words that cannot be broken.
bool is_one_word(const std::string& line) {
  const std::size_t begin = line.find_first_not_of(' ');
  return begin == std::string::npos || line.find(' ', begin) == std::string::npos;
}

void fits(const std::string& arguments) {
  const Outcome piped = run(arguments);
  that(piped.status == 0 && !piped.out.empty(), piped, "prints", __LINE__);
  for (const unsigned columns : {80U, 120U}) {
    const Outcome shown = on_terminal(arguments, columns);
    for (const std::string& line : lines(shown.out))
      that(columns_of(line) <= columns || is_one_word(line), shown, "'" + line + "' fits",
           __LINE__);
    that(without_blanks(shown.out) == without_blanks(piped.out), shown, "the same words", __LINE__);
  }
}

void every_command_fits() {
  const std::string examples = (fs::current_path() / "examples/machines").string();
  const std::string turnmill =
      "--machine " + examples + "/turnmill.ini --trace " +
      (fs::current_path() / "tests/data/turnmill/part_excerpt.csv").string();
  const std::string cut = "--machine " + examples + "/koike_cut.ini";
  put("moves.txt", kMoves);
  fits("simulate drive --machine " + examples + "/koike_cut.ini --motion moves.txt --out x.csv");
  fits("simulate milling " + cut + " --duration 0.4 --out cut.csv");
  fits("identify idle --quiet --machine " + examples +
       "/koike_cut.ini --trace x.csv --out idle.ini");
  fits("identify torque-band --quiet " + cut + " --out band.csv cut.csv");
  fits("monitor --quiet " + turnmill + " --events events.jsonl");
  fits("lobes --quiet " + cut + " --speeds 60");
  fits("pockets --quiet " + cut + " --trace cut.csv");
  fits("export --c idle.ini --out machine.h");
  fits("report events.jsonl --out events.html");
  fits("reconcile --quiet --machine " + examples + "/koike_cut.ini --trace x.csv --out reconciled");
  for (const char* help : {"--help", "help monitor", "help identify", "help identify idle",
                           "help simulate drive", "help lobes"})
    fits(help);
}

// The last column of a row is where its further lines begin.
void columns_line_up() {
  const std::string arguments =
      "monitor --quiet --machine " +
      (fs::current_path() / "examples/machines/turnmill.ini").string() + " --trace " +
      (fs::current_path() / "tests/data/turnmill/part_excerpt.csv").string();
  const std::vector<std::string> all = lines(on_terminal(arguments, 80).out);
  std::size_t column = 0, rows = 0, further = 0;
  for (const std::string& line : all) {
    std::size_t at = line.find("does not run: ");
    if (at == std::string::npos) at = line.find("runs: ");
    if (at != std::string::npos) {
      CHECK(column == 0 || at == column);
      column = at;
      ++rows;
    } else if (rows > 0) {
      CHECK(line.find_first_not_of(' ') == column);
      ++further;
    }
  }
  CHECK(rows >= 9 && further >= 3);
}

// Bytes that a terminal obeys, in the name of a file, and bytes that are no UTF-8.
void names_are_harmless() {
  const std::string name = "a\033[31mb\xff";
  put(name + ".ini", content(fs::current_path() / "examples/machines/koike_cut.ini"));
  put("moves.txt", kMoves);
  const std::string machine = "--machine '" + name + ".ini' ";
  for (const std::string& arguments :
       {"simulate drive " + machine + "--motion moves.txt --out '" + name + ".csv'",
        "monitor " + machine + "--trace '" + name + ".csv' --events '" + name + ".jsonl'",
        "export --c '" + name + ".ini' --out '" + name + ".h'",
        "report '" + name + ".jsonl' --out '" + name + ".html'",
        "reconcile " + machine + "--trace '" + name + ".csv' --out '" + name + "'"}) {
    const Outcome o = run(arguments);
    for (const std::string* text : {&o.out, &o.err})
      that(text->find('\033') == std::string::npos && text->find('\xff') == std::string::npos, o,
           "prints no escape", __LINE__);
    that(contains(o.out + o.err, "a\\x1b[31mb\\xff"), o, "names it", __LINE__);
  }
  for (const char* file : {".h", ".html"}) {
    const std::string text = content(folder / (name + file));
    CHECK(!text.empty() && text.find('\033') == std::string::npos &&
          text.find('\xff') == std::string::npos);
  }
}

// Work that takes time says so, where somebody looks; --quiet does not.
void progress_is_shown() {
  put("cut.ini", content(fs::current_path() / "examples/machines/koike_cut.ini") +
                     "\n[monitor.collision]\ncutting_torque_Nm = 0.1\n");
  const std::string cut = "--machine cut.ini";
  for (const std::string& arguments :
       {std::string("simulate milling ") + cut + " --duration 0.4 --out cut.csv",
        std::string("identify torque-band ") + cut + " --out band.csv cut.csv",
        std::string("pockets ") + cut + " --trace cut.csv",
        std::string("lobes --method sd --speeds 8 ") + cut,
        std::string("monitor ") + cut + " --trace cut.csv --events e.jsonl",
        std::string("report e.jsonl --out e.html"),
        std::string("identify collision ") + cut + " --out c.ini cut.csv"}) {
    that(contains(on_terminal(arguments, 80, true).out, "\033[K"), run("--version"),
         arguments + " shows its progress", __LINE__);
    that(!contains(on_terminal(arguments + " --quiet", 80, true).out, "\033[K"), run("--version"),
         arguments + " --quiet does not", __LINE__);
  }
}

// Numbers that mean nothing are refused with the range.
void numbers_out_of_range() {
  const std::string cut =
      "--machine " + (fs::current_path() / "examples/machines/koike_cut.ini").string();
  for (const char* value : {"0", "-1", "nan", "inf", "1e-300", "1e300", "1e400", "abc", "5x",
                            "0x10", "' 5'", "''", "1,5"}) {
    for (const char* option : {"--from", "--to", "--depth", "--speeds"})
      refused("lobes " + cut + " --method sd " + option + " " + value, 2, {option}, __LINE__);
    refused("monitor " + cut + " --trace x.csv --pace " + std::string(value), 2, {"--pace"},
            __LINE__);
    if (value != std::string("1e-300") && value != std::string("1e300")) continue;
    refused("identify idle " + cut + " --trace x.csv --out o.ini --false-alarm-rate-per-hour " +
                std::string(value),
            2, {"--false-alarm-rate-per-hour", "from"}, __LINE__);
  }
}

}  // namespace

int main() {
  return in_own_folder("console", [] {
    every_command_fits();
    columns_line_up();
    names_are_harmless();
    progress_is_shown();
    numbers_out_of_range();
  });
}
