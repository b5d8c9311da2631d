"""The C file around translated functions: types, memory, and how Python calls them."""

from __future__ import annotations

from native.translate import CELLS, Program, Type, c_type, is_array, parts, rank

HEAD = r"""/* Written by native/; do not edit. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>
#ifndef M_PI
#define M_PI 3.14159265358979323846
#endif
#if defined(_MSC_VER)
#pragma warning(disable : 4068)
#endif
typedef long long I;
typedef unsigned char B;
typedef struct Block { struct Block *next; void *data; } Block;
typedef struct { Block *first; jmp_buf out; } Arena;

static void *taken(Arena *arena, int zero, I bytes) {
    Block *block = malloc(sizeof(Block));
    void *data = block == NULL || bytes < 0 ? NULL : zero ? calloc(1, bytes ? (size_t)bytes : 1) : malloc(bytes ? (size_t)bytes : 1);
    if (data == NULL) { free(block); longjmp(arena->out, 1); }
    block->data = data; block->next = arena->first; arena->first = block;
    return data;
}
static void released(Arena *arena) {
    while (arena->first != NULL) {
        Block *block = arena->first;
        arena->first = block->next; free(block->data); free(block);
    }
}
static int kept(Arena *arena, void *data) {
    for (Block **at = &arena->first; *at != NULL; at = &(*at)->next)
        if ((*at)->data == data) { Block *block = *at; *at = block->next; free(block); return 1; }
    return 0;
}
static inline I quotient(I a, I b) { I q = a / b; return q - ((a % b != 0) && ((a < 0) != (b < 0))); }
static inline I rest(I a, I b) { return a - quotient(a, b) * b; }
static inline I min_i(I a, I b) { return b < a ? b : a; }
static inline I max_i(I a, I b) { return b > a ? b : a; }
static inline double min_f(double a, double b) { return b < a ? b : a; }
static inline double max_f(double a, double b) { return b > a ? b : a; }
"""

OWNED = r"""
/* Memory that a function returns, as an object that numpy reads. */
typedef struct { PyObject_HEAD void *data; const char *format; int cell, rank; Py_ssize_t shape[4], strides[4]; } Owned;
static void owned_end(PyObject *self) { free(((Owned *)self)->data); PyObject_Free(self); }
static int owned_buffer(PyObject *self, Py_buffer *view, int flags) {
    Owned *o = (Owned *)self;
    Py_ssize_t size = o->cell;
    for (int k = 0; k < o->rank; k++) size *= o->shape[k];
    (void)flags;
    view->obj = self; Py_INCREF(self);
    view->buf = o->data; view->len = size; view->readonly = 0; view->itemsize = o->cell;
    view->format = (char *)o->format; view->ndim = o->rank; view->shape = o->shape; view->strides = o->strides;
    view->suboffsets = NULL; view->internal = NULL;
    return 0;
}
static PyBufferProcs owned_procs = { owned_buffer, NULL };
static PyTypeObject owned_type = {
    PyVarObject_HEAD_INIT(NULL, 0) .tp_name = "native.Owned", .tp_basicsize = sizeof(Owned),
    .tp_dealloc = owned_end, .tp_as_buffer = &owned_procs, .tp_flags = Py_TPFLAGS_DEFAULT,
};
static PyObject *asarray, *ascontiguous, *copyto;

static PyObject *handed(Arena *arena, void *data, char cell, int ranks, const I *n) {
    int size = cell == 'b' ? 1 : 8;
    I bytes = size;
    for (int k = 0; k < ranks; k++) bytes *= n[k];
    if (!kept(arena, data)) { /* a part of something else */
        void *copy = malloc(bytes ? (size_t)bytes : 1);
        if (copy == NULL) return PyErr_NoMemory();
        memcpy(copy, data, (size_t)bytes); data = copy;
    }
    Owned *o = PyObject_New(Owned, &owned_type);
    if (o == NULL) { free(data); return NULL; }
    o->data = data; o->cell = size; o->rank = ranks; o->format = cell == 'f' ? "d" : cell == 'i' ? "q" : "?";
    Py_ssize_t stride = size;
    for (int k = ranks - 1; k >= 0; k--) { o->shape[k] = n[k]; o->strides[k] = stride; stride *= n[k]; }
    PyObject *out = PyObject_CallOneArg(asarray, (PyObject *)o);
    Py_DECREF(o);
    return out;
}

/* Arrays that Python hands in: contiguous ones as they are, others as copies that are written back. */
typedef struct { int count; Py_buffer view[64]; PyObject *copy[64], *of[64]; } Held;
static int held(Held *h, PyObject *given, char cell, int ranks, void **data, I *n, const char *name) {
    Py_buffer *view = &h->view[h->count];
    PyObject *copy = NULL;
    if (PyObject_GetBuffer(given, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
        PyErr_Clear();
        copy = PyObject_CallOneArg(ascontiguous, given);
        if (copy == NULL || PyObject_GetBuffer(copy, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
            Py_XDECREF(copy);
            return -1;
        }
    }
    h->copy[h->count] = copy; h->of[h->count] = given; h->count++;
    char got = view->format == NULL ? 'B' : view->format[0];
    int fits = cell == 'f' ? got == 'd' : cell == 'i' ? ((got == 'l' || got == 'q') && view->itemsize == 8) : got == '?';
    if (!fits || view->ndim != ranks) {
        PyErr_Format(PyExc_TypeError, "%s: %d axes of '%c', expected %d of '%c'", name, view->ndim, got, ranks, cell);
        return -1;
    }
    *data = view->buf;
    for (int k = 0; k < ranks; k++) n[k] = view->shape[k];
    return 0;
}
static int let_go(Held *h, int write) {
    int failed = 0;
    for (int k = 0; k < h->count; k++) {
        PyBuffer_Release(&h->view[k]);
        if (h->copy[k] != NULL) {
            PyObject *flags = write && !failed ? PyObject_GetAttrString(h->of[k], "flags") : NULL;
            PyObject *free_ = flags == NULL ? NULL : PyObject_GetAttrString(flags, "writeable");
            if (free_ != NULL && PyObject_IsTrue(free_)) {
                PyObject *done = PyObject_CallFunctionObjArgs(copyto, h->of[k], h->copy[k], NULL);
                if (done == NULL) failed = 1;
                Py_XDECREF(done);
            }
            Py_XDECREF(flags); Py_XDECREF(free_); Py_DECREF(h->copy[k]);
        }
    }
    return failed;
}
static int whole(PyObject *given, I *out) {
    PyObject *number = PyNumber_Index(given);
    if (number == NULL) return -1;
    *out = PyLong_AsLongLong(number);
    Py_DECREF(number);
    return *out == -1 && PyErr_Occurred() ? -1 : 0;
}
"""


def _array(cell: str, r: int) -> str:
    """Type and helpers of arrays of one rank."""
    name, c = f"{cell}{r}", CELLS[cell]
    lengths = ", ".join(f"I n{k}" for k in range(r))
    product = " * ".join(f"a.n[{k}]" for k in range(r))
    stride = "".join(f" * a.n[{k}]" for k in range(1, r))
    rest = "".join(f", a.n[{k}]" for k in range(1, r))
    return f"""
typedef struct {{ {c} *p; I n[{r}]; }} {name};
static inline {name} {name}_new(Arena *arena, int zero, {lengths}) {{
    {name} a = {{ NULL, {{ {", ".join(f"n{k}" for k in range(r))} }} }};
    a.p = taken(arena, zero, {product} * (I)sizeof({c}));
    return a;
}}
static inline {name} {name}_filled({name} a, {c} value) {{
    const I size = {product};
    for (I k = 0; k < size; k++) a.p[k] = value;
    return a;
}}
static inline void {name}_copied({name} a, {name} from) {{ memmove(a.p, from.p, (size_t)({product}) * sizeof({c})); }}
static inline {name} {name}_copy(Arena *arena, {name} a) {{
    {name} out = a;
    out.p = taken(arena, 0, {product} * (I)sizeof({c}));
    {name}_copied(out, a);
    return out;
}}
static inline {name} {name}_part({name} a, I low, I high) {{
    if (high > a.n[0]) high = a.n[0];
    if (low > high) low = high;
    return ({name}){{ a.p + low{stride}, {{ high - low{rest} }} }};
}}
static inline {c} {name}_max({name} a) {{
    const I size = {product};
    {c} out = a.p[0];
    for (I k = 1; k < size; k++) out = a.p[k] > out ? a.p[k] : out;
    return out;
}}"""


def _taken(program: Program, kind: Type, given: str, into: str, name: str) -> list[str]:
    """Lines that turn a Python object into a value in C."""
    if kind in program.tuples:
        fields = program.tuples[kind]
        lines = [
            f"if (!PyTuple_Check({given}) || PyTuple_GET_SIZE({given}) != {len(fields)}) "
            f'{{ PyErr_SetString(PyExc_TypeError, "{name}: expected {kind}"); goto end; }}'
        ]
        for k, (member, its) in enumerate(fields):
            lines += _taken(program, its, f"PyTuple_GET_ITEM({given}, {k})", f"{into}.{member}", f"{name}.{member}")
        return lines
    if is_array(kind):
        return [
            f"if (held(&h, {given}, '{kind[0]}', {rank(kind)}, (void **)&{into}.p, {into}.n, \"{name}\") != 0) goto end;"
        ]
    if kind == "f":
        return [f"{into} = PyFloat_AsDouble({given}); if ({into} == -1.0 && PyErr_Occurred()) goto end;"]
    if kind == "b":
        return [f"{{ int t = PyObject_IsTrue({given}); if (t < 0) goto end; {into} = (B)t; }}"]
    return [f"if (whole({given}, &{into}) != 0) goto end;"]


def _given(kind: Type, value: str) -> str:
    """A C expression that makes a Python object of a value."""
    if is_array(kind):
        return f"handed(&arena, {value}.p, '{kind[0]}', {rank(kind)}, {value}.n)"
    return {
        "f": f"PyFloat_FromDouble({value})",
        "i": f"PyLong_FromLongLong({value})",
        "b": f"PyBool_FromLong({value})",
    }[kind]


def _wrapper(program: Program, name: str, names: list[str], kinds: list[Type], c_name: str, result: Type) -> str:
    """The function as Python calls it."""
    lines = [f"    {c_type(k)} a_{n} = {{0}};" for n, k in zip(names, kinds, strict=True)]
    returns = result != "v"
    if returns:
        lines.append(f"    {c_type(result)} found = {{0}};")
    lines += [
        "    Held h; h.count = 0;", "    Arena arena; arena.first = NULL;", "    PyObject *volatile out = NULL;",
        f"    if (count != {len(names)}) {{ PyErr_SetString(PyExc_TypeError, \"{name} takes {len(names)} arguments\"); return NULL; }}",
    ]  # fmt: skip
    for k, (n, kind) in enumerate(zip(names, kinds, strict=True)):
        lines += ["    " + line for line in _taken(program, kind, f"given[{k}]", f"a_{n}", n)]
    call = f"{c_name}({', '.join(['&arena', *(f'a_{n}' for n in names)])})"
    lines += [
        "    PyThreadState *thread = PyEval_SaveThread();",
        "    if (setjmp(arena.out) != 0) { PyEval_RestoreThread(thread); PyErr_NoMemory(); goto end; }",
        f"    {'found = ' if returns else ''}{call};", "    PyEval_RestoreThread(thread);",
    ]  # fmt: skip
    if not returns:
        lines.append("    Py_INCREF(Py_None); out = Py_None;")
    elif result.startswith("("):
        inside = parts(result)
        lines.append(f"    out = PyTuple_New({len(inside)});")
        lines.append("    if (out == NULL) goto end;")
        for k, kind in enumerate(inside):
            lines.append(
                f"    {{ PyObject *one = {_given(kind, f'found.m{k}')}; if (one == NULL) {{ Py_CLEAR(out); goto end; }} "
                f"PyTuple_SET_ITEM(out, {k}, one); }}"
            )
    else:
        lines.append(f"    out = {_given(result, 'found')};")
    lines += [
        "end:",
        "    if (let_go(&h, out != NULL) != 0) Py_CLEAR(out);",
        "    released(&arena);",
        "    return out;",
    ]
    head = f"static PyObject *py_{c_name}(PyObject *module, PyObject *const *given, Py_ssize_t count) {{\n    (void)module;"
    return "\n".join([head, *lines, "}"])


def c_file(program: Program, module: str, stamp: str, best: str) -> str:
    """The whole extension `module`; every exported function is an attribute "FILE:NAME" of it.

    `best` is the extension to use instead on processors with AVX2 and FMA.
    """
    files = " ".join(unit.path.name for unit in program.units.values())
    exported = program.exported()
    out = [HEAD]
    out += [_array(cell, r) for cell in CELLS for r in range(1, 5)]
    for name, fields in program.tuples.items():
        out.append("typedef struct { " + " ".join(f"{c_type(k)} {n};" for n, k in fields if k != "?") + f" }} {name};")
    for kind in program.returned:
        inside = " ".join(f"{c_type(k)} m{i};" for i, k in enumerate(parts(kind)))
        out.append(f"typedef struct {{ {inside} }} {c_type(kind)};")
    out += program.bodies
    out.append(OWNED)
    methods = []
    for place, name, kinds, c_name, result in exported:
        names = [a.arg for a in program.units[place].functions[name].args.args]
        out.append(_wrapper(program, name, names, kinds, c_name, result))
        methods.append(
            f'    {{ "{place.rpartition(".")[2]}:{name}", (PyCFunction)(void (*)(void))py_{c_name}, METH_FASTCALL, NULL }},'
        )
    out.append("static PyMethodDef methods[] = {\n" + "\n".join(methods) + "\n    { NULL, NULL, 0, NULL }\n};")
    out.append(f"""
static struct PyModuleDef definition = {{ PyModuleDef_HEAD_INIT, "{module}", NULL, -1, methods, NULL, NULL, NULL, NULL }};
PyMODINIT_FUNC PyInit_{module}(void) {{
    if (PyType_Ready(&owned_type) < 0) return NULL;
    PyObject *numpy = PyImport_ImportModule("numpy");
    if (numpy == NULL) return NULL;
    asarray = PyObject_GetAttrString(numpy, "asarray");
    ascontiguous = PyObject_GetAttrString(numpy, "ascontiguousarray");
    copyto = PyObject_GetAttrString(numpy, "copyto");
    Py_DECREF(numpy);
    if (asarray == NULL || ascontiguous == NULL || copyto == NULL) return NULL;
    const char *best = "";
#if defined(__GNUC__) && defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) best = "{best}";
#endif
    PyObject *self = PyModule_Create(&definition);
    if (self == NULL) return NULL;
    if (PyModule_AddStringConstant(self, "stamp", "{stamp}") != 0
        || PyModule_AddStringConstant(self, "files", "{files}") != 0
        || PyModule_AddStringConstant(self, "best", best) != 0) Py_CLEAR(self);
    return self;
}}
""")
    return "\n".join(out)
