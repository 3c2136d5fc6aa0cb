/* Calls of kernels from Python: arguments become words, the GIL is released, a violated check becomes an exception.

   Included behind the kernels' own C. A kernel's type is prepared from its signature at the first call, by Python
   (phalanx/kernel.py), so that importing costs little. */

#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdio.h>
#include <structmember.h>
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#include <numpy/arrayobject.h>
#include <numpy/arrayscalars.h>

enum { MOST_WORDS = 96, MOST_OPS = 96 };

struct op {
    char letter;   /* of the signature (calling.py) */
    uint8_t axes;  /* of an array */
    uint8_t written;
    int32_t count; /* items of a tuple */
    PyObject *of;  /* an array's or record's dtype, a bundle's class, a tuple's class or None */
    PyObject *equivalent; /* another dtype that was found to be so */
};

typedef struct {
    PyObject_HEAD
    const struct entry *entry;
    PyObject *names, *defaults, *dict;
    int32_t parameters, ops, returned; /* how many; where the returned value's begin */
    struct op *op;
} Kernel;

static PyObject *prepare, *raise_violation, *report; /* functions of phalanx.kernel */
static PyObject *address_name;

static int raise_type_error(const char *what, PyObject *value)
{
    PyErr_Format(PyExc_TypeError, "%s, not %R", what, value);
    return -1;
}

static int convert_array(struct op *op, PyObject *value, word *words, int *at)
{
    if (!PyArray_Check(value)) return raise_type_error("an array is expected", value);
    PyArrayObject *array = (PyArrayObject *)value;
    PyObject *dtype = (PyObject *)PyArray_DESCR(array);
    if (dtype != op->of && dtype != op->equivalent) {
        if (!PyArray_EquivTypes((PyArray_Descr *)dtype, (PyArray_Descr *)op->of)) {
            PyErr_Format(PyExc_TypeError, "an array of %R is expected, not of %R", op->of, dtype);
            return -1;
        }
        Py_INCREF(dtype);
        Py_XDECREF(op->equivalent);
        op->equivalent = dtype;
    }
    if (PyArray_NDIM(array) != op->axes) {
        PyErr_Format(PyExc_TypeError, "an array with %d axes is expected, not %d", op->axes, PyArray_NDIM(array));
        return -1;
    }
    if (!PyArray_IS_C_CONTIGUOUS(array) || !PyArray_ISALIGNED(array)) {
        PyErr_SetString(PyExc_TypeError, "an array in C order is expected");
        return -1;
    }
    if (op->written && !PyArray_ISWRITEABLE(array)) {
        PyErr_SetString(PyExc_ValueError, "an array is read-only, and the kernel writes to it");
        return -1;
    }
    words[(*at)++].p = PyArray_DATA(array);
    for (int k = 0; k < op->axes; k++) words[(*at)++].i = PyArray_DIM(array, k);
    return 0;
}

static int convert(Kernel *self, int *k, PyObject *value, word *words, int *at)
{
    struct op *op = &self->op[(*k)++];
    switch (op->letter) {
    case 'i': case 'u': case 'b': {
        /* Only numbers whose conversion runs no Python code: that could take away the memory of an earlier array. */
        if (op->letter == 'b') {
            if (!PyBool_Check(value) && !PyLong_Check(value) && !PyArray_IsScalar(value, Bool)) return raise_type_error("a bool is expected", value);
            words[(*at)++].i = PyObject_IsTrue(value);
            return 0;
        }
        if (!PyLong_Check(value) && !PyArray_IsScalar(value, Integer)) return raise_type_error("a whole number is expected", value);
        if (PyLong_Check(value)) {
            words[*at].u = op->letter == 'u' ? PyLong_AsUnsignedLongLong(value) : (uint64_t)PyLong_AsLongLong(value);
        } else {
            PyObject *number = PyNumber_Index(value);
            if (number == NULL) return -1;
            words[*at].u = op->letter == 'u' ? PyLong_AsUnsignedLongLong(number) : (uint64_t)PyLong_AsLongLong(number);
            Py_DECREF(number);
        }
        return words[(*at)++].u == (uint64_t)-1 && PyErr_Occurred() ? -1 : 0;
    }
    case 'd': case 'f': {
        if (!PyFloat_Check(value) && !PyLong_Check(value) && !PyArray_IsScalar(value, Number) && !PyArray_IsScalar(value, Bool))
            return raise_type_error("a number is expected", value);
        words[*at].d = PyFloat_AsDouble(value);
        return words[(*at)++].d == -1.0 && PyErr_Occurred() ? -1 : 0;
    }
    case 'a':
        return convert_array(op, value, words, at);
    case 'r': {
        if (!PyArray_IsScalar(value, Void)) return raise_type_error("a record is expected", value);
        PyVoidScalarObject *record = (PyVoidScalarObject *)value;
        if (op->written && record->base != NULL && PyArray_Check(record->base) && !PyArray_ISWRITEABLE((PyArrayObject *)record->base)) {
            PyErr_SetString(PyExc_ValueError, "a record is read-only, and the kernel writes to it");
            return -1;
        }
        if (!PyArray_EquivTypes((PyArray_Descr *)record->descr, (PyArray_Descr *)op->of))
            return raise_type_error("a record of another dtype is expected", value);
        words[(*at)++].p = record->obval;
        return 0;
    }
    case 'p': {
        if ((PyObject *)Py_TYPE(value) != op->of) {
            PyErr_Format(PyExc_TypeError, "a bundle of %R is expected, not %R", op->of, value);
            return -1;
        }
        PyObject *address = PyObject_GetAttr(value, address_name);
        if (address == NULL) return -1;
        words[*at].u = PyLong_AsUnsignedLongLong(address);
        Py_DECREF(address);
        if (words[*at].u == (uint64_t)-1 && PyErr_Occurred()) return -1;
        /* Before a bundle's words is one that is not 0 if an array in it is read-only (phalanx/bundle.py). */
        if (op->written && UNLIKELY(((const word *)words[*at].p)[-1].i != 0)) {
            PyObject *which = PyObject_GetAttrString(value, "_read_only");
            if (which != NULL) PyErr_Format(PyExc_ValueError, "%S is read-only, and the kernel writes to its bundle", which);
            Py_XDECREF(which);
            return -1;
        }
        ++*at;
        return 0;
    }
    default:
        if (!PyTuple_Check(value) || PyTuple_Size(value) != op->count) {
            PyErr_Format(PyExc_TypeError, "a tuple of %d is expected, not %R", op->count, value);
            return -1;
        }
        for (int n = 0; n < op->count; n++)
            if (convert(self, k, PyTuple_GetItem(value, n), words, at) < 0) return -1;
        return 0;
    }
}

/* A number of numpy's: its operators are others than Python's. */
static PyObject *number_of(int type, void *value)
{
    PyArray_Descr *of = PyArray_DescrFromType(type);
    PyObject *made = of != NULL ? PyArray_Scalar(value, of, NULL) : NULL;
    Py_XDECREF((PyObject *)of);
    return made;
}

static PyObject *convert_result(Kernel *self, int *k, const word *words, int *at)
{
    struct op *op = &self->op[(*k)++];
    switch (op->letter) {
    case 'n': return Py_NewRef(Py_None);
    case 'i': return PyLong_FromLongLong(words[(*at)++].i);
    case 'u': return number_of(NPY_UINT64, (void *)(uintptr_t)&words[(*at)++].u);
    case 'b': return PyBool_FromLong(words[(*at)++].i != 0);
    case 'd': return PyFloat_FromDouble(words[(*at)++].d);
    case 'f': {
        float narrow = (float)words[(*at)++].d;
        return number_of(NPY_FLOAT32, &narrow);
    }
    case 'a': {
        const char *data = words[(*at)++].p;
        npy_intp lengths[4], size = PyDataType_ELSIZE((PyArray_Descr *)op->of);
        for (int n = 0; n < op->axes; n++) size *= lengths[n] = words[(*at)++].i;
        Py_INCREF(op->of);
        PyObject *made = PyArray_Empty(op->axes, lengths, (PyArray_Descr *)op->of, 0);
        if (made != NULL && size > 0) memcpy(PyArray_DATA((PyArrayObject *)made), data, (size_t)size);
        return made;
    }
    default: {
        PyObject *items = PyTuple_New(op->count);
        if (items == NULL) return NULL;
        for (int n = 0; n < op->count; n++) {
            PyObject *item = convert_result(self, k, words, at);
            if (item == NULL || PyTuple_SetItem(items, n, item) < 0) { Py_DECREF(items); return NULL; }
        }
        if (op->of == Py_None) return items;
        PyObject *made = PyObject_Call(op->of, items, NULL);
        Py_DECREF(items);
        return made;
    }
    }
}

/* The argument number n: positional, by name (which is counted), or a default; borrowed. */
static PyObject *argument(Kernel *self, PyObject *args, PyObject *named, Py_ssize_t given, Py_ssize_t n, Py_ssize_t *by_name)
{
    if (n < given) return PyTuple_GetItem(args, n);
    PyObject *name = PyTuple_GetItem(self->names, n), *value = named ? PyDict_GetItemWithError(named, name) : NULL;
    if (value != NULL) ++*by_name;
    if (value != NULL || PyErr_Occurred()) return value;
    Py_ssize_t first = self->parameters - PyTuple_Size(self->defaults);
    if (n >= first) return PyTuple_GetItem(self->defaults, n - first);
    PyErr_Format(PyExc_TypeError, "%s: argument %U is missing", self->entry->name, name);
    return NULL;
}

/* Log the violations that guarded kernels survived. */
static int report_defects(void)
{
    while (__atomic_test_and_set(&defects.lock, __ATOMIC_ACQUIRE)) continue;
    struct defects found = defects;
    defects.count = 0;
    __atomic_clear(&defects.lock, __ATOMIC_RELEASE);
    int failed = 0;
    for (int32_t k = 0; k < found.count; k++) {
        struct fault f = found.at[k].fault;
        PyObject *done = PyObject_CallFunction(report, "siiLLL", f.file, f.line, f.what, (long long)f.index,
                                               (long long)f.size, (long long)found.at[k].times);
        failed |= done == NULL;
        Py_XDECREF(done);
    }
    return failed ? -1 : 0;
}

static PyObject *call(PyObject *object, PyObject *args, PyObject *named)
{
    Kernel *self = (Kernel *)object;
    if (UNLIKELY(self->op == NULL)) {
        PyObject *done = PyObject_CallFunctionObjArgs(prepare, object, NULL);
        if (done == NULL) return NULL;
        Py_DECREF(done);
    }
    Py_ssize_t given = PyTuple_Size(args), by_name = 0;
    if (given > self->parameters || given + (named ? PyDict_Size(named) : 0) > self->parameters) {
        PyErr_Format(PyExc_TypeError, "%s takes %d arguments", self->entry->name, self->parameters);
        return NULL;
    }
    word words[MOST_WORDS], result[MOST_WORDS];
    int k = 0, at = 0;
    for (Py_ssize_t n = 0; n < self->parameters; n++) {
        PyObject *value = argument(self, args, named, given, n, &by_name);
        if (value == NULL || convert(self, &k, value, words, &at) < 0) return NULL;
    }
    if (UNLIKELY(named != NULL && by_name != PyDict_Size(named))) {
        PyErr_Format(PyExc_TypeError, "%s: of %R, a name is unknown or its argument given twice", self->entry->name, named);
        return NULL;
    }
    struct frame frame;
    int failed;
    PyThreadState *state = PyEval_SaveThread();
    enter(&frame);
    if ((failed = setjmp(frame.jump)) == 0) self->entry->call(words, result);
    PyEval_RestoreThread(state);
    PyObject *made = NULL;
    if (UNLIKELY(failed)) {
        struct fault *f = &frame.fault;
        PyObject *done = PyObject_CallFunction(raise_violation, "siiLL", f->file, f->line, f->what, (long long)f->index, (long long)f->size);
        Py_XDECREF(done);
    } else {
        at = 0;
        made = convert_result(self, &k, result, &at);
    }
    leave(&frame);
    if (UNLIKELY(__atomic_load_n(&defects.count, __ATOMIC_RELAXED) != 0)) {
        PyObject *class, *error, *trace; /* of a check that failed after guarded ones */
        PyErr_Fetch(&class, &error, &trace);
        if (report_defects() < 0) {
            Py_CLEAR(made);
            Py_XDECREF(class); Py_XDECREF(error); Py_XDECREF(trace);
        } else if (class != NULL) {
            PyErr_Restore(class, error, trace);
        }
    }
    return made;
}

/* A kernel knows its Python function, and that its module, which knows the kernel: the garbage collector must see it. */
static int traverse(PyObject *object, visitproc visit, void *arg)
{
    Kernel *self = (Kernel *)object;
    for (int n = 0; n < self->ops; n++) { Py_VISIT(self->op[n].of); Py_VISIT(self->op[n].equivalent); }
    Py_VISIT(self->names);
    Py_VISIT(self->defaults);
    Py_VISIT(self->dict);
    Py_VISIT(Py_TYPE(object));
    return 0;
}

static int clear(PyObject *object)
{
    Py_CLEAR(((Kernel *)object)->dict);
    return 0;
}

static void release_kernel(PyObject *object)
{
    Kernel *self = (Kernel *)object;
    PyObject_GC_UnTrack(object);
    for (int n = 0; n < self->ops; n++) { Py_XDECREF(self->op[n].of); Py_XDECREF(self->op[n].equivalent); }
    PyMem_Free(self->op);
    Py_XDECREF(self->names);
    Py_XDECREF(self->defaults);
    Py_XDECREF(self->dict);
    PyTypeObject *type = Py_TYPE(object);
    PyObject_GC_Del(object);
    Py_DECREF(type);
}

/* ops: [(letter, axes, written, count, dtype or class or None)] of all parameters, then of what is returned. */
static PyObject *prepare_kernel(PyObject *object, PyObject *args)
{
    Kernel *self = (Kernel *)object;
    PyObject *list, *names, *defaults;
    int parameters;
    if (!PyArg_ParseTuple(args, "O!O!O!i", &PyList_Type, &list, &PyTuple_Type, &names, &PyTuple_Type, &defaults, &parameters))
        return NULL;
    Py_ssize_t count = PyList_Size(list);
    struct op *made = PyMem_Calloc((size_t)count + 1, sizeof *made);
    if (made == NULL) return PyErr_NoMemory();
    for (Py_ssize_t n = 0; n < count; n++) {
        int letter, axes, written;
        if (!PyArg_ParseTuple(PyList_GetItem(list, n), "CiiiO", &letter, &axes, &written, &made[n].count, &made[n].of)) {
            PyMem_Free(made);
            return NULL;
        }
        made[n].letter = (char)letter; made[n].axes = (uint8_t)axes; made[n].written = (uint8_t)written;
        Py_INCREF(made[n].of);
    }
    self->names = Py_NewRef(names);
    self->defaults = Py_NewRef(defaults);
    self->parameters = parameters;
    self->ops = (int32_t)count;
    self->op = made;
    Py_RETURN_NONE;
}

static PyObject *entry_of(PyObject *object, void *Py_UNUSED(closure))
{
    const struct entry *entry = ((Kernel *)object)->entry;
    return Py_BuildValue("sK", entry->name, (unsigned long long)entry->writes);
}

static PyMethodDef methods_of_kernel[] = {{"prepare", prepare_kernel, METH_VARARGS, "Set how arguments are converted."}, {NULL, NULL, 0, NULL}};
static PyGetSetDef getters[] = {{"entry", entry_of, NULL, "Its name, and a bit for each parameter that it writes to.", NULL}, {NULL, NULL, NULL, NULL, NULL}};
static PyMemberDef members[] = {{"__dictoffset__", T_PYSSIZET, offsetof(Kernel, dict), 1, NULL}, {NULL, 0, 0, 0, NULL}};
static PyType_Slot slots[] = {
    {Py_tp_call, call}, {Py_tp_dealloc, release_kernel}, {Py_tp_traverse, traverse}, {Py_tp_clear, clear}, {Py_tp_methods, methods_of_kernel},
    {Py_tp_getset, getters}, {Py_tp_members, members}, {Py_tp_doc, (void *)"A compiled kernel."}, {0, NULL},
};
static PyType_Spec spec = {"phalanx._kernels.Kernel", sizeof(Kernel), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, slots};
static PyTypeObject *type;

static PyObject *kernel(PyObject *Py_UNUSED(module), PyObject *number)
{
    long n = PyLong_AsLong(number);
    if (n < 0 || n >= (long)(sizeof entries / sizeof *entries - 1)) return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
    Kernel *made = PyObject_GC_New(Kernel, type);
    if (made == NULL) return NULL;
    memset((char *)made + sizeof(PyObject), 0, sizeof *made - sizeof(PyObject));
    made->entry = &entries[n];
    PyObject_GC_Track(made);
    return (PyObject *)made;
}

static PyObject *set_up(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *first, *second, *third;
    if (!PyArg_ParseTuple(args, "OOO", &first, &second, &third)) return NULL;
    prepare = Py_NewRef(first);
    raise_violation = Py_NewRef(second);
    report = Py_NewRef(third);
    Py_RETURN_NONE;
}

static PyObject *link_c(PyObject *Py_UNUSED(module), PyObject *args)
{
    int slot;
    unsigned long long address;
    if (!PyArg_ParseTuple(args, "iK", &slot, &address)) return NULL;
    linked[slot] = (void *)(uintptr_t)address;
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"kernel", kernel, METH_O, "Return the compiled kernel of a number."},
    {"set_up", set_up, METH_VARARGS, "Set what prepares a kernel at its first call, what raises violations, and what logs those of guarded kernels."},
    {"link", link_c, METH_VARARGS, "Set the address of a C function that kernels call."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "phalanx._kernels", "Compiled kernels.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernels(void)
{
    import_array();
    address_name = PyUnicode_InternFromString("_address");
    type = (PyTypeObject *)PyType_FromSpec(&spec);
    PyObject *made = PyModule_Create(&module), *names = PyDict_New();
    if (address_name == NULL || type == NULL || made == NULL || names == NULL) return NULL;
    for (long n = 0; entries[n].name != NULL; n++) {
        PyObject *number = PyLong_FromLong(n);
        if (number == NULL || PyDict_SetItemString(names, entries[n].name, number) < 0) return NULL;
        Py_DECREF(number);
    }
    if (PyModule_AddObjectRef(made, "names", names) < 0 || PyModule_AddObjectRef(made, "Kernel", (PyObject *)type) < 0) return NULL;
    if (PyModule_AddStringConstant(made, "table", TABLE) < 0) return NULL;
    return made;
}
