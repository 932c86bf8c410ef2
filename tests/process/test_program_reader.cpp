// The reader on programs whose meaning is worked out by hand.
#include <cmath>

#include "check.hpp"
#include "io/malformed.hpp"
#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace {

using namespace servosense::process;
using Kind = CanonicalMove::Kind;

struct Run {
  std::vector<CanonicalMove> moves;
  std::string error;
  std::size_t line = 0;
};

Run run(const std::string& text, ProgramOptions options = {}) {
  Run r;
  ProgramPlace place;
  const auto done = run_program(
      ProgramText::from(text, "part.ngc"), options,
      [&](const CanonicalMove& move) { r.moves.push_back(move); }, &place);
  if (!done) r.error = done.error().sentence, r.line = place.line;
  return r;
}

ProgramOptions fanuc() {
  ProgramOptions options;
  options.dialect = Dialect::fanuc;
  return options;
}

/// X of every move, in mm.
std::string xs(const Run& r) {
  std::string out;
  for (const CanonicalMove& m : r.moves)
    if (is_motion(m.kind))
      out += (out.empty() ? "" : " ") + std::to_string(std::lround(m.end[0] * 1e3));
  return r.error.empty() ? out : out + " | " + r.error;
}

void moves_in_metres() {
  const Run r =
      run("G21 G90 G0 X10 Y20 Z5\nG1 Z-1 F300 S1200 M3\nG2 X20 Y30 I10 J0\nG20 G0 X1\nM2\n");
  CHECK(r.error.empty());
  CHECK(r.moves.size() == 7);
  CHECK_NEAR(r.moves[0].end[1], 0.02, 1e-15);
  const CanonicalMove& arc = r.moves[4];
  CHECK(arc.kind == Kind::arc && arc.turns == -1);
  CHECK_NEAR(arc.centre_m[0], 0.02, 1e-15);
  CHECK_NEAR(arc.feed_m_s, 0.005, 1e-15);
  CHECK_NEAR(arc.spindle_rpm, 1200, 0);
  CHECK_NEAR(arc_angle_rad(arc, r.moves[3].end), -std::acos(-1.0) / 2, 1e-12);
  CHECK_NEAR(path_length(arc, r.moves[3].end), 0.01 * std::acos(-1.0) / 2, 1e-12);
  CHECK_NEAR(r.moves[5].end[0], 0.0254, 1e-15);
  CHECK(r.moves[5].line == 4);
  CHECK(r.moves.back().kind == Kind::end);
}

void machine_points() {
  const Run r = run("G10 L2 P1 X100 Y50 R90\nG92 X1 Y1 Z0\nG0 X11 Y1\nG53 G0 X0 Y0\nM2\n");
  // G92 at the machine's zero, seen from a system turned by 90 degrees: (-50, 100) becomes (1, 1).
  CHECK_NEAR(r.moves[0].machine[0], 0, 1e-12);
  CHECK_NEAR(r.moves[0].machine[1], 0.01, 1e-12);
  CHECK_NEAR(r.moves[1].machine[0], 0, 1e-12);
  CHECK_NEAR(r.moves[1].machine[1], 0, 1e-12);
}

void feeds() {
  const Run r = run("G93 G1 X60 F2\nG94\nG1 A90 F180\nG95 S600 M3 F0.1\nG1 X0\nM2\n");
  CHECK_NEAR(r.moves[0].feed_m_s, 0.002, 1e-15);  // 60 mm in half a minute
  CHECK_NEAR(r.moves[1].feed_deg_s, 3, 1e-12);
  CHECK_NEAR(r.moves[1].feed_m_s, 0, 0);
  CHECK_NEAR(r.moves[4].feed_m_s, 0.001, 1e-15);
  CHECK_NEAR(r.moves[4].feed_m_rev, 0.0001, 1e-18);
}

void fanuc_macros() {
  CHECK_TEXT(xs(run("%\nO1000\n#1=0\nWHILE[#1LT3]DO1\n#1=#1+1\nM30\n%\n", fanuc())),
             " | part.ngc:5: a word is expected where '+1' stands");
  CHECK_TEXT(xs(run("%\nO1000\n#1=0\nWHILE[#1LT3]DO1\n#1=[#1+1]\nG0X#1\nEND1\nM30\n%\n", fanuc())),
             "1 2 3");
  CHECK_TEXT(xs(run("#1=1\nN10 G0 X#1\n#1=[#1+1]\nIF [#1 LE 3] GOTO 10\nM30\n", fanuc())), "1 2 3");
  CHECK_TEXT(xs(run("IF [1 EQ 1] THEN #1=7\nIF [1 EQ 2] THEN #1=8\nG0 X#1\nGOTO 5\nX9\nN5 M30\n",
                    fanuc())),
             "7");
  CHECK_TEXT(xs(run("G0 X1\nM98 P8000 L2\nX9\nM30\nO8000\nG91 X1\nG90\nM99\n", fanuc())),
             "1 2 3 9");
  CHECK_TEXT(xs(run("WHILE [1 EQ 2] DO 1\nG0 X1\nEND 1\nG0 X2\nM30\n", fanuc())), "2");
  CHECK_TEXT(xs(run("GOTO 7\nM30\n", fanuc())),
             " | part.ngc:1: GOTO 7 leads nowhere; there is no line N7");
  CHECK_TEXT(xs(run("DO 2\nDO 1\nEND 2\nM30\n",
                    [] {
                      ProgramOptions options = fanuc();
                      options.most_lines = 100;
                      return options;
                    }())),
             " | part.ngc:1: the program has run 100 lines without coming to its end; does a loop "
             "here never end?");
  CHECK_TEXT(xs(run("END 1\nM30\n", fanuc())), " | part.ngc:1: END 1 has no DO 1 before it");
}

void fanuc_words() {
  const Run r = run("G4 P500\nG4 X1.5\nF100 G81 X1 Z-1 R1\nM30\n", fanuc());
  CHECK_NEAR(r.moves[0].seconds, 0.5, 1e-15);
  CHECK_NEAR(r.moves[1].seconds, 1.5, 1e-15);
  CHECK(run("G0 X#0\nM30\n", fanuc()).error.find("#0") != std::string::npos);
}

void endless() {
  ProgramOptions options;
  options.most_lines = 1000;
  const Run r = run("O1 while [1]\nG0 X1\nO1 endwhile\nM2\n", options);
  CHECK(r.error.find("does a loop here never end?") != std::string::npos);
  CHECK(r.line >= 1 && r.line <= 3);
  options = {};
  options.most_moves = 500;
  const Run pecks = run("F100 G83 X1 Z-1 R1 Q0.0000001\nM2\n", options);
  CHECK(pecks.line == 1 && pecks.error.find("more than 500 moves") != std::string::npos);
  CHECK(pecks.moves.size() == 500);
  CHECK(run("O1 sub\nO1 call\nO1 endsub\nO1 call\nM2\n").line == 2);
}

void refusals() {
  struct Case {
    const char *text, *part;
    std::size_t line;
  };
  const Case cases[] = {
      {"G0 X1\nG38.2 Z-5 F10\nM2\n", "trips is known on the machine alone", 2},
      {"G76 P1 Z-1 I-1 J1 K2\nM2\n", "cycle of lathes", 1},
      {"G5 X1 Y1 I1 J1 P1 Q1\nM2\n", "splines", 1},
      {"G7\nM2\n", "there is no G7", 1},
      {"G50\nM2\n", "there is no G50", 1},
      {"M101\nM2\n", "a program of the machine's own", 1},
      {"G0 X#5061\nM2\n", "what a probe found", 1},
      {"M66 P0\nG0 X#5399\nM2\n", "what M66 read", 2},
      {"S100 G96\nM2\n", "bounds no speed", 1},
      {"G0 X1\n", "ends without M2", 1},
      {"G0 X9999999999\nM2\n", "farther than any machine", 1},
      {"F1 G81 X1 Z-1 R1\nG20 X2\nM2\n", "units change while a drilling cycle", 2}};
  for (const Case& c : cases) {
    const Run r = run(c.text);
    check::that(r.error.find(c.part) != std::string::npos && r.line == c.line,
                (std::string(c.text) + r.error).c_str(), __FILE__, __LINE__);
  }
}

void tool_files() {
  const auto table =
      tool_table_of("T1 P1 D6.0 Z10.5 ;end mill\n\n;none\nT2 P7 X1 D10 I30 J120 Q3\n", "t.tbl");
  CHECK(table.has_value() && table->size() == 2);
  CHECK_NEAR(table->at(1).offset[2], 0.0105, 1e-15);
  CHECK_NEAR(table->at(1).diameter_m, 0.006, 1e-15);
  CHECK_TEXT(table->at(1).remark, "end mill");
  CHECK(table->at(2).pocket == 7 && table->at(2).orientation == 3);
  for (const char* wrong : {"P1 D3\n", "T1\nT1\n", "T1 K3\n", "T1.5\n", "T1 D\n"})
    CHECK(!tool_table_of(wrong, "t.tbl").has_value());
  const auto parameters = parameters_of("5221\t1.5\n5220 2.0\n", "v.var");
  CHECK(parameters.has_value() && parameters->at(5221) == 1.5);
  for (const char* wrong : {"1\n", "x 1\n", "1 2 3\n", "9999 1\n"})
    CHECK(!parameters_of(wrong, "v.var").has_value());
  ProgramOptions options;
  options.tools = *table;
  options.parameters = {{5221, 100.0}, {5223, -20.0}};
  const Run r = run("T1 M6\nG43\nG0 X0 Z0\nM2\n", options);
  CHECK_NEAR(r.moves[1].machine[0], 0.1, 1e-12);
  CHECK_NEAR(r.moves[1].machine[2], -0.0095, 1e-12);
  CHECK(r.moves[1].tool == 1);
  CHECK(run("T3\nM2\n", options).error.find("not in the tool table") != std::string::npos);
}

void malformed_programs() {
  malformed::check_all("nc_program", 27, [](const std::string& path) {
    const auto text = ProgramText::read(path);
    if (!text) return text.error();
    const auto done = run_program(*text, {}, [](const CanonicalMove&) {});
    return done ? servosense::Error{} : done.error();
  });
}

void plain_time() {
  PlainTime::Sink none = [](const CanonicalMove&, double) {};
  PlainTime time({{0.1, 0.2, 0.5}}, none);
  const std::string program =
      "G0 X10 Y40 Z5\n"                         // 0.1 s of x, 0.2 s of y: the slower
      "G10 L2 P1 X500 R30\n"                    // no move
      "F600 G91 G1 X30\n"                       // 3 s
      "G2 I10\n"                                // 2 pi s
      "G4 P1.25\nS60 M3\nG33.1 Z-10 K1\nM2\n";  // 1 mm/s, 10 mm there and back
  const auto done = run_program(ProgramText::from(program, "part.ngc"), {},
                                [&](const CanonicalMove& move) { time.put(move); });
  CHECK(done.has_value());
  CHECK_NEAR(time.now_s(), 0.2 + 3 + 2 * std::acos(-1.0) + 1.25 + 20, 1e-9);
}

}  // namespace

int main() {
  malformed_programs();
  plain_time();
  moves_in_metres();
  machine_points();
  feeds();
  fanuc_macros();
  fanuc_words();
  endless();
  refusals();
  tool_files();
  return check::done();
}
