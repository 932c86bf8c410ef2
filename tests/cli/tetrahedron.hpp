// The smallest STL file: a corner of 10 mm, down to z = -10 mm.
#pragma once

namespace tetrahedron {

inline constexpr const char* kStl = R"(solid corner
facet normal 0 0 -1
outer loop
vertex 0 0 -10
vertex 0 10 -10
vertex 10 0 -10
endloop
endfacet
facet normal 0 -1 0
outer loop
vertex 0 0 -10
vertex 10 0 -10
vertex 0 0 -5
endloop
endfacet
facet normal -1 0 0
outer loop
vertex 0 0 -10
vertex 0 0 -5
vertex 0 10 -10
endloop
endfacet
facet normal 1 1 2
outer loop
vertex 10 0 -10
vertex 0 10 -10
vertex 0 0 -5
endloop
endfacet
endsolid corner
)";

}  // namespace tetrahedron
